"""How long a job will take: what short runs of it tell, by a clock of the test and by steps."""

from unittest.mock import patch

import pytest
from letters import spring, swing

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.request import Observations, observations
from fvi_cli.planning.seconds import short_job, time_runs

GAUSS = Method(cq="gauss", degree=2, start="none")


class Job:
    """A job that takes what a formula says, on a clock of its own."""

    def __init__(self, takes):
        self.takes, self.now, self.sizes = takes, 0.0, []

    def __call__(self, n_steps):
        self.sizes.append(n_steps)
        # what the first one prepares
        self.now += self.takes(n_steps) + (7.0 if len(self.sizes) == 1 else 0.0)

    def timing(self, n_steps, **options):
        return time_runs(self, n_steps, clock=lambda: self.now, **options)


def test_steps_that_cost_the_same():
    job = Job(lambda n: 0.05 + 1e-4 * n)
    timing = job.timing(10**6, is_quadratic=False)
    assert job.sizes == [16, 16, 64, 256, 1024]
    for n in (16, 100, 1000, 10**4, 10**6):
        assert timing.at(n) == pytest.approx(0.05 + 1e-4 * n)


@pytest.mark.parametrize("is_quadratic", [True, False])
def test_steps_that_sum_over_all_before_them(is_quadratic):
    job = Job(lambda n: 0.001 + 2e-6 * n + 1e-8 * n**2)
    found = job.timing(10**5, is_quadratic=is_quadratic).at(10**5)
    exact = 0.001 + 0.2 + 100
    assert (found == pytest.approx(exact)) is is_quadratic
    assert is_quadratic or found < exact / 10


def test_tables_that_a_longer_run_makes_are_no_cost_of_a_step():
    """Rises by more than the square of the steps are looked at once more."""
    job = Job(lambda n: 0.002 + 1e-6 * n + (0.12 if n > 2000 else 0.0))
    timing = job.timing(2**18, is_quadratic=False)
    assert max(job.sizes) == 16384
    assert timing.at(2**18) == pytest.approx(0.122 + 1e-6 * 2**18)


def test_a_short_job_is_run_itself_and_a_slow_one_twice():
    job = Job(lambda n: 0.0006 * n)
    assert job.timing(20, is_quadratic=False).at(20) == pytest.approx(0.012)
    # short ones are noisy
    assert job.sizes == [16, 16, 16, 16, 20]
    slow = Job(lambda n: 3.0 + n)
    assert slow.timing(1000, n_runs=10, is_quadratic=False).at(1000) == pytest.approx(100.3)
    assert slow.sizes == [16, 16, 64]


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
        short_job([scene], GAUSS, 1000, observations=[wanted])(40)
    degrees = [2, 4] if asked else [2]
    assert [degree for degree, *_ in made] == degrees
    assert all(n == 40 and h == pytest.approx(0.05) for _, n, h in made)
