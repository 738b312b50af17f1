"""What complaints say to write is understood; the complaints are in tests/mistakes."""

import numpy as np
import pytest
from command_line import configuration

from fvi_cli.config import parse_config

SPRING = "kind: damped-oscillator, final_time: 1.0, initial: {position: 1.0}, exact: none"
SHAKEN = "kind: frame, storeys: 3, stiffness: 40.0, final_time: 2.0, exact: none"


def test_a_record_in_g_is_scaled_to_metres_and_seconds(tmp_path):
    (tmp_path / "quake.csv").write_text("t,a\n0,0.25\n2,-0.5\n")

    def acceleration(scale):
        record = f"{{file: quake.csv, column: a, scale: {scale}}}"
        text = configuration(f"{SHAKEN}, ground_acceleration: {record}")
        (experiment,) = parse_config(text, "f.yaml", base=tmp_path).experiments
        return experiment.problem.scene.forcing.pieces[0].evaluate(np.array([2.0]))

    assert acceleration("g") == pytest.approx(9.80665 * acceleration("1.0"), rel=1e-14)


FORCED = """
name: f
problem:
  kind: duffing
  damping: [{order: 0.6, coefficient: 0.25}]
  parameters: {F: 0.4, w: 2.0}
  forcing: F*cos(w*t)
  initial: {position: 0.5}
  final_time: 10.0
  exact: none
method: gauss3
ladder: {steps: [64]}
events: {period: {when: sin(w*t), direction: rising}}
"""


def test_null_leaves_out_a_key():
    usual = FORCED.replace("method: gauss3\n", "")
    found = [
        parse_config(text, "f.yaml", overrides=changes).experiments[0]
        for text, changes in (
            (FORCED, ["method=null", "events=~"]),
            (usual, ["events=null"]),
            (FORCED, ["events.period=null", "method=null", "events=null"]),
        )
    ]
    assert len({one.methods for one in found}) == 1
    assert not any(one.observations.events for one in found)
