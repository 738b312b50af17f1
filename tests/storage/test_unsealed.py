"""A file whose bytes cannot be verified is refused unless it is asked for."""

from pathlib import Path

import h5py
import pytest
from command_line import configuration, fvi

from fvi_cli.storage import stream
from fvi_cli.storage.files import UNSEALED

CONFIG = configuration(
    "kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0", name="small"
)
FILE = "results/small.h5"
READERS = (
    ("show", FILE),
    ("convergence", FILE, "-o", "out"),
    ("export", FILE, "--to", "csv", "-o", "out"),
    ("merge", FILE, "-o", "out"),
    ("run", "small.yaml"),
    ("plot", "small.yaml", "-o", "results"),
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unsealed: None) -> None:
    monkeypatch.delenv(UNSEALED)
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(CONFIG)
    fvi("run", "small.yaml", "-q", code=0)


def without_seal() -> bytes:
    content = Path(FILE).read_bytes()
    return content[: content.rindex(stream.MARK)]


def changed(how: str) -> None:
    """Change the file as another program, a cut, or a mutation that takes the seal would."""
    if how == "annotated":
        with h5py.File(FILE, "r+") as file:
            file.attrs["note"] = "seen"
    elif how == "cut":
        Path(FILE).write_bytes(without_seal()[:4000])
    elif how == "foreign":
        Path(FILE).unlink()
        with h5py.File(FILE, "w") as file:
            file["x"] = 1.0
    else:
        # a heap of texts whose directory is empty: the library searches it for ever
        content = bytearray(without_seal())
        begin = content.index(b"GCOL")
        content[begin + 16 : begin + 400] = bytes(384)
        Path(FILE).write_bytes(content)


@pytest.mark.few(8)
@pytest.mark.parametrize("command", READERS, ids=lambda command: command[0])
@pytest.mark.parametrize("how", ["annotated", "cut", "foreign", "endless"])
def test_what_cannot_be_verified_is_refused_by_every_reader(command, how):
    changed(how)
    before = Path(FILE).read_bytes()
    told = fvi(*command, code=2).stderr
    assert f"{FILE}: cannot be verified: it was cut off, changed by another program" in told
    assert f"set {UNSEALED}=1 to read it nevertheless" in told
    assert Path(FILE).read_bytes() == before


def test_who_asks_for_it_reads_what_another_program_left(monkeypatch):
    shown = fvi("show", FILE, code=0).stdout
    Path(FILE).write_bytes(without_seal())
    fvi("show", FILE, code=2)
    monkeypatch.setenv(UNSEALED, "1")
    assert fvi("show", FILE, code=0).stdout == shown
    # an empty value asks for nothing
    monkeypatch.setenv(UNSEALED, "")
    fvi("show", FILE, code=2)


def test_what_was_moved_away_is_computed_again():
    Path(FILE).write_bytes(without_seal())
    fvi("run", "small.yaml", "-q", code=2)
    Path(FILE).replace("results/old.h5")
    fvi("run", "small.yaml", "-q", code=0)
    fvi("show", FILE, code=0)
