"""Forces from CSV files: how they are read, what is kept of them, and every mistake."""

import base64
import hashlib
import json
import zlib

import numpy as np
import pytest

from fvi_cli.config import find_config, load_config, parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.scenes.records.data_files import samples_as_text, samples_from_text
from fvi_cli.scenes.registry import build_problem

CSV = "t,a,b\n0,0,1\n0.5,1,2\n1.0,-1e-1,3\n2,4,4\n"
CONFIG = """\
name: shaken
problem:
  kind: bagley-torvik
  damping: [{order: 0.5, coefficient: 1.0}]
  forcing: {file: quake.csv, column: a}
  final_time: 2.0
ladder: {steps: [8]}
"""


FILES = {"quake.csv": CSV, "shaken.yaml": CONFIG}


def load(folder, text=CONFIG):
    (folder / "shaken.yaml").write_text(text)
    return load_config(folder / "shaken.yaml")


def forcing_of(config):
    return config.experiments[0].problem.scene.forcing


def test_a_relative_path_begins_at_the_configuration(folder, monkeypatch):
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    forcing = forcing_of(load(folder))
    time = np.array([0.0, 0.25, 1.0, 1.5])
    np.testing.assert_allclose(forcing(time)[:, 0], [0.0, 0.5, -0.1, 1.95])


def test_the_resolved_configuration_needs_the_file_no_more(folder):
    config = load(folder)
    described = config.experiments[0].problem_specification["forcing"]
    assert described["sha256"] == hashlib.sha256(CSV.encode()).hexdigest()
    assert described["interpolation"] == "linear"
    time, values = samples_from_text(described["content"])
    assert time.tolist() == [0.0, 0.5, 1.0, 2.0]
    assert values.tolist() == [0.0, 1.0, -0.1, 4.0]
    (folder / "quake.csv").unlink()
    again = parse_config(json.dumps(config.resolved), "stored")
    assert again.resolved == config.resolved
    time = np.linspace(0, 2, 33)
    np.testing.assert_array_equal(forcing_of(again)(time), forcing_of(config)(time))
    # so does what a process gets
    rebuilt = build_problem(config.experiments[0].problem_specification)
    np.testing.assert_array_equal(rebuilt.scene.forcing(time), forcing_of(config)(time))


def test_another_content_is_another_run(folder):
    def specification():
        return load(folder).experiments[0].runs()[0].specification()

    before = specification()
    assert specification() == before
    (folder / "quake.csv").write_text(CSV.replace("0.5,1,2", "0.5,1.0000001,2"))
    assert specification() != before


def test_per_coordinate_scaled_and_with_a_spline(folder):
    text = CONFIG.replace(
        "{file: quake.csv, column: a}",
        "[sin(t), {file: quake.csv, column: b, interpolation: cubic, scale: 2}]",
    )
    text = text.replace("final_time", "mass: [[1, 0], [0, 1]]\n  final_time")
    forcing = forcing_of(load(folder, text))
    time = np.array([0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(forcing(time)[:, 0], np.sin(time))
    np.testing.assert_allclose(forcing(time)[:, 1], [2, 4, 6, 8], rtol=1e-12)
    assert [sample.order for sample in forcing.samples] == [4]


def test_the_ground_of_a_frame(folder):
    text = """\
name: shaken
problem:
  kind: frame
  storeys: 2
  mass: [2.0, 1.0]
  ground_acceleration: {file: quake.csv, column: a, scale: 3}
  final_time: 2.0
ladder: {steps: [8]}
"""
    forcing = forcing_of(load(folder, text))
    np.testing.assert_allclose(forcing(np.array([0.5])), [[-6.0, -3.0]])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_comments_and_byte_order_marks(folder, separator):
    content = "﻿# a record\n\n" + CSV.replace(",", separator) + "\n# the end\n"
    (folder / "quake.csv").write_text(content, encoding="utf-8")
    assert forcing_of(load(folder))(np.array([2.0]))[0, 0] == pytest.approx(4.0, rel=1e-15)


def test_text_of_samples_is_without_loss():
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.random(500))
    values = rng.standard_normal(500) * 10.0 ** rng.integers(-300, 300, 500)
    again = samples_from_text(samples_as_text(time, values))
    np.testing.assert_array_equal(again[0], time)
    np.testing.assert_array_equal(again[1], values)


@pytest.mark.parametrize("text", ["", "AAAA", "no base64!", "eJwDAAAAAAE="])
def test_text_that_holds_no_samples(text):
    with pytest.raises(ValueError, match="samples"):
        samples_from_text(text)


def test_huge_files_are_refused(folder):
    rows = "".join(f"{k},{k % 7}\n" for k in range(100_002))
    (folder / "quake.csv").write_text("t,a\n" + rows)
    with pytest.raises(ConfigError, match=r"quake\.csv:100002: more than 100000 samples"):
        load(folder)
    rng = np.random.default_rng(1)
    rows = "".join(f"{k},{v!r}\n" for k, v in enumerate(rng.standard_normal(60_000).tolist()))
    (folder / "quake.csv").write_text("t,a\n" + rows)
    with pytest.raises(ConfigError, match="more than 500000; thin them out"):
        load(folder)


def test_a_bomb_is_not_unpacked():
    bomb = base64.b64encode(zlib.compress(b"1.0,1.0\n" * 1_000_000)).decode()
    with pytest.raises(ValueError, match="more than 100000 samples"):
        samples_from_text(bomb)


def test_the_shipped_ground_motion_is_what_its_comment_says():
    path = find_config("frame-quake").with_name("ground-motion.csv")
    record = np.loadtxt(path, delimiter=",", skiprows=3)
    t, k = record[:, 0], np.arange(1, 9)[:, None]
    formula = (t / 2) ** 2 * np.exp(2 - t) * np.cos((1 + 2 * k) * t + k**2).sum(axis=0) / 4
    np.testing.assert_allclose(record[:, 1], formula, atol=5.1e-5)
