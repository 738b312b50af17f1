"""Remarks on what is valid and surely not meant are told in time; they stand in tests/mistakes."""

import pytest
from command_line import configuration, fvi

from fvi_cli.config import shipped_configs
from fvi_cli.runner.request import gather, plausibility_remarks


@pytest.mark.few(10)
@pytest.mark.parametrize("name", shipped_configs())
def test_what_is_shipped_is_not_remarked_on(name):
    for request in gather([name]):
        assert plausibility_remarks(request) == []


def test_check_and_run_say_them_and_others_do_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = configuration("kind: damped-oscillator, final_time: 1.0, exact: none")
    (tmp_path / "made.yaml").write_text(text, encoding="utf-8")
    for command, is_said in (("check", True), ("run", True), ("modes", False)):
        output = fvi(command, "made.yaml", code=0).output
        assert ("stays at rest" in output) == is_said
    assert "stays at rest" not in fvi("check", "made.yaml", "-q", code=0).output
