"""The hard cases: everything holds with Gauss3, the truth is the truth, the report is current.

The whole is computed by ``fvi hard-cases``; here it is Gauss3 on all cases but the longest, and
samples of the others.
"""

import dataclasses
import functools
import json
import math
import tempfile
from pathlib import Path

import mpmath
import numpy as np
import pytest
from command_line import fvi
from spread import spread
from stored_results import stored_hard_cases

from benchmarks.talbot import talbot_inverse
from fvi_cli.config.hard_cases import hard_cases
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.reports import compare, write
from fvi_cli.reports.kinds.hard_cases import hard_case_report
from fvi_cli.scenes.linear_response import linear_response
from fvi_cli.studies.hard_cases.case import (
    FLAGSHIP,
    CaseSetting,
    Claim,
    Finding,
    HardCase,
    HardCaseReport,
    examine,
    examined_methods,
)
from fvi_cli.studies.hard_cases.judges import exact_positions, judge_of, response_from_rest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
CASES = hard_cases()
METHODS = examined_methods()
LONG = ("million-steps", "resonance", "tiny-and-huge-scales", "chaotic-double-pendulum")
STORED = stored_hard_cases()


def of(case: HardCase, *methods: str) -> HardCaseReport:
    findings = tuple(one for name in methods for one in examine(case, name, METHODS[name]))
    return HardCaseReport(cases=(case,), findings=findings, is_partial=True)


def setting(
    n_steps: int = 1000, *, order: float = 1.0, coefficient: float = 0.0, stiffness: float = 1.0
) -> CaseSetting:
    """A free oscillator on [0, 50] from x(0) = 1, whose truth is cos t."""
    problem = {
        "kind": "damped-oscillator",
        "stiffness": stiffness,
        "damping": [{"order": order, "coefficient": coefficient}],
        "initial": {"position": 1.0},
        "final_time": 50.0,
    }
    return CaseSetting(json.dumps(problem), n_steps, '"cos(t)"')


def measured(claim: Claim, one: CaseSetting) -> float:
    """What the judge of a claim finds in a run of another setting, with the flagship."""
    judge = functools.partial(claim.judge.func, (one,), **claim.judge.keywords)
    return judge(integrate(one.scene, METHODS[FLAGSHIP], one.n_steps))


def only(claim: Claim, method: str) -> Finding:
    case = HardCase(name="a", title="", description="", reference="", claims=(claim,))
    (finding,) = examine(case, method, METHODS[method])
    return finding


@spread(few=2, name=[n for n in CASES if n not in LONG])
def test_much_holds_with_gauss3(name):
    check_everything_holds(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_longer_cases_hold_with_gauss3(name):
    check_everything_holds(name)


def check_everything_holds(name: str) -> None:
    report = of(CASES[name], FLAGSHIP)
    assert report.findings
    for finding in report.findings:
        assert finding.holds, finding
        assert finding.status == "ok"
        assert finding.predicted != "unstable"
    assert compare(RESULTS, hard_case_report(report)) == []


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["order-1-9-coefficient-100", "jumps-at-every-period"])
def test_other_methods_are_found_as_the_report_says(name):
    chosen = ("BDF3 points", "BDF6 nodes", "Radau IIA 3", "Gauss1")
    report = of(CASES[name], *chosen)
    assert compare(RESULTS, hard_case_report(report)) == []
    assert not all(finding.holds for finding in report.findings)


def test_the_committed_report_has_every_case_and_method_and_gauss3_holds():
    assert list(dict.fromkeys(finding.case for finding in STORED.findings)) == list(CASES)
    assert set(STORED.methods) == set(METHODS)
    own = [finding for finding in STORED.findings if finding.method == FLAGSHIP]
    assert len(own) == sum(len(case.claims) for case in CASES.values())
    assert all(finding.holds for finding in own)
    assert compare(RESULTS, hard_case_report(STORED)) == []


HELD_BY_ALL = {
    "runs that are called unstable",
    "angle between two paths that start 1e-6 apart",
    "largest change of the energy",
    "pendulum in units of time, g = 0.5",
    "Duffing in units of length, g = 0.5",
    "Duffing in units of length, g = 1.5",
}


def test_every_claim_can_fail():
    """Some method fails every claim, but for a few, which fail in the tests below."""
    failed = {(f.case, f.quantity) for f in STORED.findings if not f.holds}
    everything = {(f.case, f.quantity) for f in STORED.findings}
    assert {quantity for _, quantity in everything - failed} <= HELD_BY_ALL


def test_motions_that_differ_are_not_the_same_in_other_units():
    method = METHODS[FLAGSHIP]
    claims = [c for c in CASES["tiny-and-huge-scales"].claims if c.quantity in HELD_BY_ALL]
    assert len(claims) == 3
    for claim in claims:
        runs = [integrate(one.scene, method, 32) for one in claim.settings]
        assert claim.holds(claim.judge(*runs))
        moved = dataclasses.replace(runs[2], position=runs[2].position * (1 + 1e-10))
        assert not claim.holds(claim.judge(*runs[:2], moved))


def test_a_clock_that_is_slow_is_seen_beside_the_cosine():
    claim = CASES["million-steps"].claims[1]
    found = [measured(claim, one) for one in (setting(stiffness=1 - 1e-6), setting())]
    assert [claim.holds(error) for error in found] == [False, True]


def test_damping_changes_the_energy():
    claim = CASES["million-steps"].claims[0]
    assert not claim.holds(measured(claim, setting(coefficient=1e-8)))
    assert claim.holds(measured(claim, setting()))


def test_a_stable_scene_with_an_unstable_method_is_called_unstable():
    claim = CASES["negative-damping"].claims[1]
    blown = setting(400, order=1.5, coefficient=5.0)
    found = only(dataclasses.replace(claim, settings=(blown,)), "BDF6 nodes")
    assert found.measured == 1.0
    assert not found.holds


def test_paths_of_a_double_pendulum_at_rest_do_not_part():
    claim = CASES["chaotic-double-pendulum"].claims[1]
    assert claim.sense == "at least"
    assert not claim.holds(1e-9)
    assert not claim.holds(math.nan)


def test_a_run_that_ends_early_holds_nothing():
    finding = only(CASES["huge-damping"].claims[0], "BDF6 nodes")
    assert finding.status == "failed"
    assert finding.measured == math.inf
    assert finding.predicted == "unstable"
    assert not finding.holds
    assert not finding.is_comparable


# the truth


def by_talbot(scene: Scene, time: float, *, stiffness: float, fastest: float) -> float:
    """Caputo's transform of a free oscillator, by a contour in more than 60 digits."""
    (term,) = scene.damping
    k, mu = mpmath.mpf(stiffness), mpmath.mpf(float(term.coefficient[0, 0]))
    x0, v0 = float(scene.initial_position[0]), float(scene.initial_velocity[0])
    g = mpmath.mpf(term.order)

    def transform(s: mpmath.mpc) -> mpmath.mpc:
        start = s * x0 + v0 + mu * s ** (g - 1) * x0
        if g > 1:
            start += mu * s ** (g - 2) * v0
        return start / (s**2 + mu * s**g + k)

    return float(talbot_inverse(transform, (time,), largest_frequency=fastest)[0])


def test_resonance_agrees_with_talbot():
    order, mu, frequency, time = 0.5, 0.05, 1.0177, 25.0

    def transform(s: mpmath.mpc, k: float = 1.0) -> mpmath.mpc:
        return s / (s**2 + mpmath.mpf(frequency) ** 2) / (s**2 + mpmath.mpf(mu) * s**order + k)

    found = response_from_rest(order, mu, frequency)(np.array([time]))
    exact = talbot_inverse(transform, (time,), largest_frequency=1.02)
    assert found == pytest.approx(exact, rel=1e-12)
    moved = talbot_inverse(lambda s: transform(s, 1 + 1e-9), (time,), largest_frequency=1.02)
    assert found != pytest.approx(moved, rel=1e-12)


@spread(few=1, name=["extreme-orders", "huge-damping", "negative-damping"])
def test_exact_positions_agree_with_talbot(name):
    checked = 0
    for one in dict.fromkeys(s for claim in CASES[name].claims for s in claim.settings):
        scene = one.scene
        (term,) = scene.damping
        k, mu = float(scene.potential.stiffness[0, 0]), float(term.coefficient[0, 0])
        time = scene.final_time / 2
        fastest = k**0.5
        if term.order < 1 or mu < 0:
            # above 1 the balance of inertia and damping is not on the principal sheet
            fastest += abs(mu) ** (1 / (2 - term.order))
        if fastest * time > 100:
            continue  # too many digits
        checked += 1
        exact = exact_positions(one)
        found = by_talbot(scene, time, stiffness=k, fastest=fastest)
        scale = np.abs(exact).max()
        assert abs(found - exact[one.n_steps // 2, 0]) < 2e-13 * scale
        moved = by_talbot(scene, time, stiffness=k * (1 + 1e-6), fastest=fastest)
        assert abs(moved - found) > 1e-11 * scale
    assert checked >= 2


def test_the_tail_agrees_with_the_oracle():
    """Numbers of the oracle and of the Laplace inversion, and the sign of the leading term."""
    claims = [c for c in CASES["algebraic-tail"].claims if "t = 1000," in c.quantity]
    assert len(claims) == 2
    for claim in claims:
        (one,) = claim.settings
        (order,) = (term.order for term in one.scene.damping)
        value = json.loads(one.truth)
        response = linear_response(mass=1.0, stiffness=1.0, damping=((order, 1.0),), position=1.0)
        assert response(np.array([1000.0]))[0] == pytest.approx(value, rel=3e-9)
        leading = 1e4**-order / math.gamma(1 - order)
        assert response(np.array([1e4]))[0] == pytest.approx(leading, rel=1e-3)


def test_the_energy_balance_of_the_double_pendulum_sees_a_wrong_coefficient():
    (one,) = CASES["chaotic-double-pendulum"].claims[0].settings

    def defect(coefficient: float) -> float:
        problem = {
            **json.loads(one.problem),
            "joints": [{"order": 0.5, "coefficient": coefficient}],
            "final_time": 5.0,
        }
        changed = CaseSetting(json.dumps(problem), 400)
        return judge_of("energy_defect", [changed], {"hanging": -3.0})(trajectory)

    scene = dataclasses.replace(one.scene, final_time=5.0)
    trajectory = integrate(scene, METHODS[FLAGSHIP], 400)
    assert defect(0.005) < 1e-9
    assert defect(0.005005) > 1e-6


# report and command


def compared(stored: HardCaseReport, fresh: HardCaseReport) -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), hard_case_report(stored))
        (Path(folder) / "hard-cases.json").unlink()
        return compare(Path(folder), hard_case_report(fresh))


def test_a_changed_report_is_found():
    case = CASES["jumps-at-every-period"]
    report = of(case, "Gauss1", "Gauss3")

    def differences(**change: object) -> list[str]:
        first = dataclasses.replace(report.findings[0], **change)
        changed = dataclasses.replace(report, findings=(first, *report.findings[1:]))
        return compared(changed, report)

    measured = report.findings[0].measured
    assert measured > 1e-4
    assert differences() == []
    assert differences(measured=measured * (1 + 1e-4)) == []
    assert len(differences(measured=measured * 1.01)) == 1
    assert any("holds: True" in line for line in differences(measured=1e-12, holds=True))
    assert len(differences(limit=1e-3)) == 1
    assert len(differences(predicted="unstable")) == 1
    assert len(differences(status="failed")) == 1
    without = dataclasses.replace(report, findings=report.findings[1:])
    assert len(compared(without, report)) == 1


def test_a_case_that_is_described_otherwise_is_found(tmp_path):
    write(tmp_path, hard_case_report(STORED))
    (tmp_path / "hard-cases-text.tex").unlink()
    first, *others = STORED.cases
    changed = dataclasses.replace(first, description="otherwise")
    report = dataclasses.replace(STORED, cases=(changed, *others))
    (line,) = compare(tmp_path, hard_case_report(report))
    assert line.startswith(f"{tmp_path}/hard-cases.md: line ")
    assert "otherwise" in line


def test_round_off_decides_nothing():
    case = HardCase(name="a", title="", description="", reference="", claims=())

    def report(found: float, limit: float = 1e-11) -> HardCaseReport:
        claim = Claim("q", limit, (setting(64),), lambda run: found)
        return HardCaseReport(cases=(case,), findings=(only(claim, FLAGSHIP),), is_partial=True)

    assert compared(report(0.9e-11), report(1.1e-11)) == []
    assert compared(report(0.9e-14), report(1.1e-11))
    assert compared(report(0.9e-3, 1e-3), report(1.1e-3, 1e-3))
    assert compared(report(math.inf), report(math.inf)) == []


def test_the_readme_counts_what_holds_as_the_report_does():
    held = [finding.holds for finding in STORED.findings if finding.method == FLAGSHIP]
    page = (ROOT / "docs/explanation/limitations.md").read_text(encoding="utf-8")
    assert f"{FLAGSHIP} holds in {sum(held)} of {len(held)}." in " ".join(page.split())


def test_the_command(tmp_path):
    write(tmp_path, hard_case_report(STORED))
    some = ["--case", "order-1-9-coefficient-100", "--method", "Gauss3", "--output", str(tmp_path)]
    shown = fvi("hard-cases", *some, code=0)
    assert "at most 1e-08" in shown.stdout
    checked = fvi("hard-cases", "--check", *some, code=0)
    assert checked.stdout == "up to date\n"
    failing = fvi("hard-cases", *some, "--method", "BDF6 nodes", code=0)  # only Gauss3 must hold
    assert "failed" in failing.stdout
    path = tmp_path / "hard-cases.csv"
    text = path.read_text()
    path.write_text(text.replace(",1e-08,", ",1e-07,"))
    stale = fvi("hard-cases", "--check", *some, code=3)
    assert "limit: 1e-07 is stored, now 1e-08" in stale.stdout
    path.write_text("{}")
    fvi("hard-cases", "--check", *some, code=3)
    path.unlink()
    fvi("hard-cases", "--check", *some, code=3)
    fvi("hard-cases", "--case", "nothing", "--method", "Gauss9", code=2)


def test_the_command_fails_when_gauss3_does_not_hold(tmp_path, monkeypatch):
    case = CASES["order-1-9-coefficient-100"]
    strict = dataclasses.replace(
        case, claims=tuple(dataclasses.replace(claim, limit=1e-20) for claim in case.claims)
    )
    monkeypatch.setattr("fvi_cli.runner.hard_cases.named_cases", lambda: {case.name: strict})
    result = fvi("hard-cases", "--method", "Gauss3", "--output", str(tmp_path), code=3)
    assert " NO" in result.stdout
    assert list(tmp_path.iterdir()) == []
    write(tmp_path, hard_case_report(of(strict, FLAGSHIP)))
    checked = fvi("hard-cases", "--check", "--method", "Gauss3", "--output", str(tmp_path), code=3)
    assert checked.stdout.count("must be at most 1e-20") == 1
