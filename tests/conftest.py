"""What tests of all rooms share."""

import gc
import logging
import sys
from pathlib import Path
from typing import Any

import pytest

# benchmarks/ is not installed; the package itself is, and comes before
sys.path.append(str(Path(__file__).parents[1]))


@pytest.fixture(autouse=True)
def _log_of_a_new_process() -> None:
    """Take back what commands of other tests have set up for the log of this process."""
    logger = logging.getLogger("fvi_cli")
    logger.setLevel(logging.NOTSET)
    logger.handlers.clear()
    logger.propagate = True


def pytest_collection_finish() -> None:
    """Leave what is imported by then out of all further looks for garbage: most of the heap."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of a file on one worker: what they share is made once."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)
