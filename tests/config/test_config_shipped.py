"""The shipped configurations, how they are found, and that a wheel carries them."""

import functools
import json
import re
from pathlib import Path

import pytest
import yaml

from fvi_cli.config import find_config, load_config, shipped_configs, starter_config
from fvi_cli.config import parse_config as parse
from fvi_cli.errors import RequestError
from fvi_cli.scenes.registry import KINDS

NAMES = shipped_configs()


@functools.cache
def shipped(name):
    return load_config(find_config(name))


@pytest.mark.few(12)
@pytest.mark.parametrize("name", NAMES)
def test_every_shipped_configuration_is_valid_and_what_is_resolved_is_the_same(name):
    config = shipped(name)
    assert config.name == name
    assert config.experiments
    assert all(e.methods and (e.steps or e.accuracy) for e in config.experiments)
    text = yaml.safe_dump(json.loads(json.dumps(config.resolved)), sort_keys=False)
    second = parse(text, "again.yaml")
    assert second.resolved == config.resolved
    for one, other in zip(config.experiments, second.experiments, strict=True):
        assert other.methods == one.methods
        assert other.steps == one.steps
        assert other.problem_specification == one.problem_specification


@pytest.mark.parametrize(
    "figure",
    [
        "{plot: peak_angle, against: problem.stiffness}",
        "{plot: turn, against: problem.stiffness, after: 5}",
        "{section: turn}",
        "{ensemble: [x, angle]}",
    ],
)
def test_figures_with_settings_are_resolved_to_what_is_valid(figure):
    text = (
        "name: a\nproblem: {kind: duffing, final_time: 10.0, exact: none}\n"
        "sweep: {problem.stiffness: [1.0, 2.0]}\nmethod: gauss3\nladder: {steps: [40]}\n"
        "quantities: {angle: x}\nevents: {turn: {when: vx, direction: falling}}\n"
        f"figures: [{figure}]\n"
    )
    config = parse(text, "a.yaml")
    second = parse(yaml.safe_dump(json.loads(json.dumps(config.resolved))), "again.yaml")
    assert second.resolved == config.resolved
    assert second.experiments[0].figures == config.experiments[0].figures


class TestFinding:
    def test_a_file_goes_first(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("table-1").write_text("name: mine")
        assert find_config("table-1") == Path("table-1")

    def test_a_folder_of_the_same_name_does_not_hide_it(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("table-1").mkdir()
        assert find_config("table-1").name == "table-1.yaml"

    @pytest.mark.parametrize("name", ["tabel-1", "tabel-1.yaml"])
    def test_the_nearest_name_is_suggested(self, name):
        with pytest.raises(RequestError, match="did you mean 'table-1'"):
            find_config(name)

    @pytest.mark.parametrize("name", ["", "a/b/c", "../configs/table-1", "x\x00y", "a" * 5000])
    def test_nothing_else_is_found(self, name, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(RequestError):
            find_config(name)


@pytest.mark.parametrize("kind", KINDS)
def test_a_starter_file_is_short_and_valid(kind):
    text = starter_config(kind)
    assert parse(text, "starter.yaml").name == f"my-{kind}"
    lines = text.splitlines()
    assert len(lines) <= 25
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("kind", [one for one in KINDS if one != "fractional-derivative"])
def test_what_a_starter_file_has_as_comments_is_valid_when_it_is_switched_on(kind, tmp_path):
    text = starter_config(kind)
    assert not any(f"\n{key}:" in text for key in ("claims", "expect"))
    text = re.sub(r"\nmethod: .*", "\nmethod: {rk: gauss, degree: 3}", text)
    for key in ("output", "quantities", "events"):
        text = re.sub(rf"\n# {key}: ([\[{{])", rf"\n{key}: \1", text)
    head, _, fit = text.partition("\n# fit:\n#   data")
    fit = "\nfit:\n  data" + fit.replace("\n#   param", "\n  param")
    lines = "\n".join(f"{1e-3 * k},{0.01 * k}" for k in range(9))
    measured = "force" if kind == "material" else "displacement"
    (tmp_path / "measured.csv").write_text(f"t,{measured}\n{lines}\n", encoding="utf-8")
    (experiment,) = parse(head + fit, "starter.yaml", base=tmp_path).experiments
    of_scenes = kind != "material"
    quantities = {"speed", "acceleration"} if of_scenes else {"force", "deformation"}
    if kind == "frame":
        quantities = {"drift_1", "acceleration_1", "base_shear"}
    assert set(experiment.observations.quantities) == quantities
    assert set(experiment.observations.events) == ({"turn"} if of_scenes else set())
    assert experiment.fit is not None
