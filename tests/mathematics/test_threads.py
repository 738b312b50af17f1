"""Linear algebra of a run is done in one thread, whatever the environment says."""

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from fvi_cli.mathematics.threads import in_one_thread


def _threads() -> set[int]:
    np.linalg.inv(np.eye(2))
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_limited_functions_have_one_thread_and_callers_keep_theirs() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = _threads()
        assert in_one_thread(_threads)() == {1}
        assert _threads() == before
