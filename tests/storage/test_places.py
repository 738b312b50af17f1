"""Where files are written: through links, and with their names where that fails."""

import errno
import os
from pathlib import Path

import pytest
from command_line import configuration, fvi
from spread import spread

from fvi_cli.storage import atomic
from fvi_cli.storage.atomic import file_lock, replace_file

CONFIG = configuration(
    "kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0", name="small"
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(CONFIG)
    Path("elsewhere").mkdir()
    Path("results").mkdir()
    return tmp_path


def link(target):
    try:
        Path("results/small.h5").symlink_to(target)
    except (OSError, NotImplementedError):
        pytest.skip("no links on this system")


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir() if path.suffix != ".lock")


@pytest.mark.parametrize("relative", [True, False])
def test_a_link_stays_and_what_it_leads_to_is_written(folder, relative):
    link("../elsewhere/kept.h5" if relative else folder / "elsewhere" / "kept.h5")
    # at first it leads to nothing
    fvi("run", "small.yaml", "-q", code=0)
    first = Path("elsewhere/kept.h5").read_bytes()
    fvi("run", "small.yaml", "-q", "--set", "ladder.steps=[8, 16, 32]", code=0)
    assert Path("results/small.h5").is_symlink()
    assert Path("elsewhere/kept.h5").read_bytes() != first
    assert fvi("show", "results/small.h5").stdout == fvi("show", "elsewhere/kept.h5").stdout
    assert (names("results"), names("elsewhere")) == (["small.h5"], ["kept.h5"])


def test_a_link_to_a_link_is_followed_to_its_end():
    link("middle.h5")
    Path("results/middle.h5").symlink_to("../elsewhere/kept.h5")
    fvi("run", "small.yaml", "-q", code=0)
    assert Path("results/small.h5").is_symlink()
    assert Path("results/middle.h5").is_symlink()
    assert names("elsewhere") == ["kept.h5"]


def test_two_links_to_one_file_share_its_lock():
    link("../elsewhere/small.h5")
    with file_lock(Path("elsewhere/small.h5")):
        told = fvi("run", "small.yaml", "-q", code=2).stderr
    assert "another fvi is writing it" in told


def test_what_a_crash_left_at_the_end_of_a_link_is_removed():
    link("../elsewhere/small.h5")
    Path("elsewhere/.small.h5.abc.part").write_bytes(b"half")
    fvi("run", "small.yaml", "-q", code=0)
    assert names("elsewhere") == ["small.h5"]


@pytest.mark.few(2)
@spread(
    command=[
        ("plot", "small.yaml"),
        ("convergence", "small.yaml"),
        ("export", "results/small.h5"),
    ],
    where=["write", "mkstemp", "fsync"],
)
def test_on_a_full_disk_the_file_is_named(monkeypatch, command, where):
    fvi("run", "small.yaml", "-q", code=0)

    def full(*arguments, **keywords):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if where == "write":
        # the disk is full when the buffer is written
        monkeypatch.setattr(atomic.os, "fdopen", full)
    else:
        monkeypatch.setattr(atomic.tempfile if where == "mkstemp" else atomic.os, where, full)
    told = fvi(*command, code=2).stderr
    (line,) = [line for line in told.splitlines() if "No space left" in line]
    assert line.startswith("fvi: ")
    named = line.split(": ")[1]
    assert Path(named).suffix in (".png", ".csv", ".md", ".tex")
    assert "small" in named


def test_an_error_of_another_file_keeps_its_name(tmp_path):
    with pytest.raises(OSError, match="No such file") as caught, atomic.replacement(Path("new")):
        Path("absent").read_bytes()
    assert caught.value.filename == "absent"
    replace_file(Path("new"), b"whole")
    assert Path("new").read_bytes() == b"whole"


@pytest.mark.parametrize("address", ["file:///x", "http://host:8786", "TCP://host:1", "://"])
def test_what_is_no_address_of_a_scheduler_is_refused_at_once(address):
    told = fvi("run", "small.yaml", "--dask", address, code=2).stderr
    assert told == (
        f"--dask {address}: is not the address of a scheduler, such as tcp://host:8786\n"
    )
