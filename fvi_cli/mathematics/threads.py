"""Products of small matrices in one thread, whatever the environment says."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _libraries() -> ThreadpoolController:
    # the library of SciPy is found once it is loaded
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


def in_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with the linear algebra of NumPy and SciPy in one thread.

    The matrices of a step are too small to share: threads that wait for each other take ten times
    as long on a machine with other work.
    """

    @wraps(function)
    def limited(*args: P.args, **named: P.kwargs) -> R:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **named)

    return limited
