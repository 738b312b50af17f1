"""What tests of all rooms share."""

import gc
import sys
from pathlib import Path

# benchmarks/ is not installed; the package itself is, and comes before
sys.path.append(str(Path(__file__).parents[1]))


def pytest_collection_finish() -> None:
    """Leave what is imported by then out of all further looks for garbage: most of the heap."""
    gc.collect()
    gc.freeze()
