"""What tests of all rooms share."""

import gc
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# benchmarks/ is not installed; the package itself is, and comes before
sys.path.append(str(Path(__file__).parents[1]))


@pytest.fixture(autouse=True)
def _log_as_before() -> Iterator[None]:
    """Take back what commands set up for the log of their process."""
    logger = logging.getLogger("fvi_cli")
    level, handlers, propagates = logger.level, list(logger.handlers), logger.propagate
    yield
    logger.setLevel(level)
    logger.handlers[:], logger.propagate = handlers, propagates


def pytest_collection_finish() -> None:
    """Leave what is imported by then out of all further looks for garbage: most of the heap."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of a file on one worker: what they share is made once."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)
