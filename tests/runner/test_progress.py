"""How long the rest takes: told when there is ground for it, and near the truth."""

import itertools

import pytest

from fvi_cli.runner.progress import LEAST_SECONDS, LEAST_SHARE, Pace, in_minutes


class Clock:
    """A clock that is set by hand."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_an_estimate_waits_until_there_is_ground_for_it_and_then_is_near_the_truth():
    """Runs of 0.05 s and 10 microseconds a step: by their share of steps the first mislead most."""
    clock = Clock()
    runs = [2**k for k in range(2, 20)] * 3
    seconds = [0.05 + 1e-5 * n for n in runs]
    pace = Pace(total=sum(runs), clock=clock)
    by_the_first = sum(runs) / runs[0] * seconds[0]
    assert by_the_first > 1000 * sum(seconds)
    for done, gone in zip(itertools.accumulate(runs), itertools.accumulate(seconds), strict=True):
        clock.now = 1000.0 + gone
        pace.reached(done)
        if pace.left is None:
            assert gone < LEAST_SECONDS or done < LEAST_SHARE * sum(runs)
        else:
            assert pace.left == pytest.approx(sum(seconds) - gone, rel=0.5, abs=1.0)
    assert pace.left == 0


def test_time_spent_on_a_reference_does_not_count():
    clock = Clock()
    pace = Pace(total=100, clock=clock)
    for _ in range(60):
        clock.now += 1.0
        pace.went_elsewhere()
    clock.now += 4.0
    pace.reached(20)
    assert pace.left == pytest.approx(16.0)
    assert str(pace) == "1:04, about 0:16 left"
    clock.now += 10.0
    assert str(pace) == "1:14, about 0:06 left"


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0:00"), (59.6, "1:00"), (3599, "59:59"), (3661, "1:01:01")]
)
def test_times_in_words(seconds, words):
    assert in_minutes(seconds) == words
