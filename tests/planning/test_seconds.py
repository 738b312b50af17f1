"""How long a job will take: what its begin tells, by a clock of the test, and by work."""

from unittest.mock import patch

import numpy as np
import pytest
from letters import spring, swing
from spread import spread

from benchmarks.forecasts import FACTOR, OBSERVED, drawn_config
from fvi_cli.integrator.advance import report_progress
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import Recurrence
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.request import Observations, observations
from fvi_cli.planning.seconds import short_job, time_job
from fvi_cli.runner.compute import run
from fvi_cli.runner.plan import forecast_runs, plan
from fvi_cli.runner.request import requested

GAUSS = Method(cq="gauss", degree=2, start="none")
CLOCK = "fvi_cli.planning.seconds.time.process_time"


class Job:
    """A job whose steps take what a formula says, on a clock of its own."""

    def __init__(self, takes, outputs=0.0):
        self.takes, self.outputs, self.now, self.sizes = takes, outputs, 0.0, []

    def __call__(self, n_steps, is_whole):
        self.sizes.append((n_steps, is_whole))
        begin = self.now
        # what the first one prepares
        begin += 7.0 if len(self.sizes) == 1 else 0.0
        for done in range(n_steps):
            self.now = begin + self.takes(done)
            report_progress(done, n_steps)
        self.now = begin + self.takes(n_steps) * (1.0 + self.outputs * is_whole)

    def timing(self, n_steps, **options):
        with patch(CLOCK, lambda: self.now):
            return time_job(self, n_steps, **options)


@pytest.mark.parametrize("outputs", [0.0, 3.0])
@pytest.mark.parametrize("each", [1e-5, 1e-4])
def test_steps_that_cost_the_same(each, outputs):
    job = Job(lambda n: 0.05 + each * n, outputs)
    timing = job.timing(20000, is_quadratic=False, n_runs=5)
    for n in (16, 100, 1000, 20000):
        assert timing.at(n) == pytest.approx((1.0 + outputs) * (0.05 + each * n) / 5)
    # the whole of what is soon done, else no more than half a second of it
    assert (timing.n_steps[-1] == 20000) is (each < 2e-5)
    assert len(job.sizes) == 4


@pytest.mark.parametrize("is_quadratic", [True, False])
def test_steps_that_sum_over_all_before_them(is_quadratic):
    job = Job(lambda n: 0.001 + 2e-6 * n + 1e-8 * n**2)
    found = job.timing(10**5, is_quadratic=is_quadratic).at(10**5)
    exact = 0.001 + 0.2 + 100
    assert (found == pytest.approx(exact, rel=1e-3)) is is_quadratic
    assert is_quadratic or found < exact / 5


def test_what_comes_once_is_no_cost_of_a_step():
    job = Job(lambda n: 0.002 + 1e-4 * n + (0.12 if n > 700 else 0.0))
    timing = job.timing(2**18, is_quadratic=False)
    assert timing.at(2**18) == pytest.approx(0.122 + 1e-4 * 2**18, rel=0.01)


def test_a_slow_job_is_stopped_behind_its_first_steps():
    slow = Job(lambda n: 3.0 + n)
    assert slow.timing(1000, n_runs=10, is_quadratic=False).at(1000) == pytest.approx(100.3)
    assert slow.sizes == [(16, True), (1000, False), (1, True), (1, False)]


class Work:
    """Solved systems as the seconds of a clock: the same whatever else the machine does."""

    def __init__(self, monkeypatch, each=0.0005):
        self.now = 0.0
        for of, name in ((Engine, "solve"), (Recurrence, "run")):
            monkeypatch.setattr(of, name, self.counted(getattr(of, name), each))
        monkeypatch.setattr(CLOCK, lambda: self.now)

    def counted(self, does, each):
        def action(*given, **options):
            self.now += each
            return does(*given, **options)

        return action


@spread(few=2, observed=OBSERVED, seed=[1, 2])
def test_forecasts_of_observed_members_are_right_within_a_factor(observed, seed, monkeypatch):
    rng = np.random.default_rng([seed, OBSERVED.index(observed)])
    # impacts are dear
    most = (2, 30) if observed == "impacts" else (12, 300)
    config = drawn_config(rng, observed, most_members=most[0], most_steps=most[1])
    request = requested(config)
    work = Work(monkeypatch)
    forecasts = forecast_runs(plan(request)).values()
    asked = work.now
    run(request, keep=False)
    found, computed = sum(one.seconds for one in forecasts), work.now - asked
    assert computed / FACTOR <= found <= FACTOR * computed
    # what one member takes says less, if there are many
    members = len(request.loaded.experiments[0].members)
    assert members <= FACTOR**2 or found / members < computed / FACTOR


@pytest.mark.parametrize("scene", [spring((0.5, 0.1), T=50.0), swing((0.5, 0.1), T=50.0)])
@pytest.mark.parametrize("asked", ["", "output", "quantities"])
def test_a_short_job_does_all_that_is_asked_in_steps_of_the_same_size(scene, asked):
    """Twice the stages for what lies between the points of its mesh, and none where it is not."""
    wanted = {
        "": Observations(),
        "output": observations(("x",), output=[0.01, 3.0, 50.0]),
        "quantities": observations(("x",), quantities={"speed": "vx"}),
    }[asked]
    made = []

    def noted(self, *arguments, **options):
        begin(self, *arguments, **options)
        made.append((self.method.degree, options["n_steps"], options["shortest_step"]))

    begin = Engine.__init__
    with patch.object(Engine, "__init__", noted):
        short_job([scene], GAUSS, 1000, observations=[wanted])(40, True)
    degrees = [2, 4] if asked else [2]
    assert [degree for degree, *_ in made] == degrees
    assert all(n == 40 and h == pytest.approx(0.05) for _, n, h in made)
