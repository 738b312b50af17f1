"""The page of constants: which there are, who reads them, what they steer."""

import math
import sys
from pathlib import Path

import pytest

from benchmarks import constants


@pytest.fixture(scope="module")
def known():
    constants.runs()  # whatever they need is imported
    return {(one.module.rpartition(".")[2], one.name): one for one in constants.constants()}


def test_constants_are_found_with_their_readers(known):
    unit = known["convergence", "UNIT"]
    assert unit.value == 2.0**-53
    assert unit.readers[0] == "fvi_cli.mathematics.convergence"
    assert "fvi_cli.integrator.engine.newton" in unit.readers
    for one in known.values():
        assert getattr(sys.modules[one.module], one.name) == one.value
        assert math.isfinite(one.value)
    # a flag and a table are no numbers
    assert not any(isinstance(one.value, bool) for one in known.values())


def test_a_constant_is_changed_wherever_it_is_read_and_put_back(known):
    unit = known["convergence", "UNIT"]
    loaded = [sys.modules[one] for one in unit.readers if one in sys.modules]
    assert len(loaded) > 1

    def fail() -> None:
        with constants.changed(unit, 0.5):
            assert {one.UNIT for one in loaded} == {0.5}
            raise RuntimeError("ends")

    with pytest.raises(RuntimeError, match="ends"):
        fail()
    assert {one.UNIT for one in loaded} == {unit.value}


def test_the_list_is_that_of_the_code(known):
    """Every number in capital letters is listed once, with what it is; the page says the values."""
    entries = constants.listed()
    places = [one.place for one in entries]
    every = {one.place: one for one in known.values()}
    assert sorted(places) == places
    assert len(set(places)) == len(places)
    assert set(places) == {place for place in every if not place.startswith("__")}
    for one in entries:
        assert one.kind in constants.KINDS
        assert one.origin
        assert every[one.place].words or one.words, one.place
    page = Path("results/constants.md").read_text(encoding="utf-8")
    for one in entries:
        row = f"| `{one.place}` | {every[one.place].value:.6g} |"
        assert row in page, f"python -m benchmarks constants --most 0 makes the page anew: {row}"


def test_few_constants_are_chosen():
    count = sum(one.kind == "knob" for one in constants.listed())
    assert count <= constants.MOST_KNOBS


def test_what_is_said_to_steer_nothing_was_measured():
    for one in constants.listed():
        if one.kind == "flat":
            assert one.change is not None, one.place
            assert one.time is not None, one.place
            assert one.change <= constants.LAST_DIGITS, one.place
            assert 1 / constants.CERTAIN < one.time < constants.CERTAIN, one.place


def test_constants_are_measured_and_kept(monkeypatch, tmp_path):
    every = {"graded": constants.runs()["graded"]}
    entries = constants.listed()
    monkeypatch.setattr(constants, "runs", lambda size=1: every)
    monkeypatch.setattr(constants, "LISTED", tmp_path / "constants.csv")
    constants.write_list(entries)
    page = constants.run_constants(most=2, repeats=1)
    changed = [a for a, b in zip(constants.listed(), entries, strict=True) if a != b]
    assert 1 <= len(changed) <= 2
    assert all(one.change is not None for one in changed)
    assert page.count("\n| `") == len(entries)
