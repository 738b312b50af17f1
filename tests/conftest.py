"""What tests of all rooms share."""

import datetime
import gc
import logging
import math
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shown_numbers import NUMBER
from spread import SEED, draw_few

# benchmarks/ is not installed; the package itself is, and comes before
sys.path.append(str(Path(__file__).parents[1]))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let answers that are kept in files be written anew."""
    parser.addoption(
        "--renew",
        action="store_true",
        help="write what is made now into the files that keep it: sessions, mistakes, pages",
    )


def pytest_configure() -> None:
    """Choose what is drawn today; workers, which are begun later, draw the same."""
    os.environ.setdefault(SEED, str(datetime.date.today().toordinal()))
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # what is begun in the background of a script, and the commands that it tests, hear none
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_report_header() -> str:
    """Say how to repeat it."""
    return f"combinations are drawn by {SEED}={os.environ[SEED]}; `-m slow` runs all others"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Draw what is run today; all that is kept is renewed."""
    if not config.getoption("--renew"):
        draw_few(items)


@pytest.fixture
def folder(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder of its own, with the files that ``FILES`` of the module has by name."""
    monkeypatch.chdir(tmp_path)
    for name, text in getattr(request.module, "FILES", {}).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def kept(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compare a text with the file of that name in ``kept/`` beside the test, or renew the file.

    Numbers may differ by round-off, as on other machines.
    """
    folder = request.path.parent / "kept"

    def compare(name: str, made: str) -> None:
        if request.config.getoption("--renew"):
            folder.mkdir(exist_ok=True)
            (folder / name).write_text(made, encoding="utf-8")
        stored = (folder / name).read_text(encoding="utf-8")
        pairs = zip(NUMBER.findall(stored), NUMBER.findall(made), strict=False)
        same = NUMBER.sub("#", stored) == NUMBER.sub("#", made) and all(
            math.isclose(float(a), float(b), rel_tol=1e-9, abs_tol=1e-15) for a, b in pairs
        )
        assert same or made == stored

    return compare


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
