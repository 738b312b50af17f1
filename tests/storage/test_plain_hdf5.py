"""A result file is plain HDF5: others may annotate it, and HDF5's checksums guard its arrays."""

import os
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import configuration, fvi

CONFIG = configuration(
    "kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0", name="small"
)
SWEEP = CONFIG + "sweep: {problem.stiffness: [1.0, 2.0, 3.0]}\n"
FILES = {"small.yaml": CONFIG, "swept.yaml": SWEEP.replace("name: small", "name: swept")}
FILE = "results/small.h5"
READERS = (
    ("show", FILE),
    ("convergence", FILE, "--output", "made"),
    ("run", "small.yaml"),
)


def first_run(file: h5py.File) -> h5py.Group:
    """The first group of runs, as a visitor finds it."""
    found: list[str] = []
    file.visit(found.append)
    return file[next(name for name in found if re.search("/n[0-9]+$", name))]


@pytest.mark.parametrize("name", ["small", "swept"])
def test_an_annotated_file_is_used_and_written_again(folder, name):
    fvi("run", f"{name}.yaml", "-q", code=0)
    with h5py.File(f"results/{name}.h5", "a") as file:
        group = first_run(file)
        for node in (file, group):
            node.attrs["note"] = "seen"
            node.attrs["good"] = np.bool_(True)
            node.attrs["empty"] = h5py.Empty("f")
        group.attrs["\x1b[2J"] = "\x1b]0;title\x07"
        group["smoothed"] = np.zeros(3)
        group["picture"] = np.zeros((4, 4), dtype=np.uint8)
        file["strangers/own"] = 1.0
    again = fvi("run", f"{name}.yaml", code=0).stderr
    assert " 0 of them stored" not in again
    for command in ("show", "convergence", "export"):
        told = fvi(command, f"results/{name}.h5", code=0)
        assert "\x1b" not in told.output
    # another ladder: the file is written anew with the runs that it has
    more = fvi("run", f"{name}.yaml", "--set", "ladder.steps=[4, 8, 16, 32, 64]", code=0).stderr
    assert " 0 of them stored" not in more
    fvi("show", f"results/{name}.h5", code=0)


def test_a_flipped_bit_of_an_array_is_reported_in_one_sentence(folder):
    fvi("run", "small.yaml", "-q", code=0)
    with h5py.File(FILE) as file:
        place = first_run(file)["position"].id.get_chunk_info(0).byte_offset
    content = bytearray(Path(FILE).read_bytes())
    content[place + 11] ^= 1
    Path(FILE).write_bytes(content)
    for reader in READERS[1:]:
        (line, *_) = [
            one for one in fvi(*reader, code=2).stderr.splitlines() if one.startswith("fvi: ")
        ]
        assert f"{FILE}: is damaged" in line
        assert "move it away" in line
    assert Path(FILE).read_bytes() == content


def test_a_pipe_in_the_place_of_a_file_does_not_hang(folder):
    Path("results").mkdir()
    os.mkfifo(FILE)
    for reader in READERS:
        assert "is a device or pipe" in fvi(*reader, code=2).stderr


@pytest.mark.skipif(os.name != "posix", reason="modes of Unix")
def test_a_private_file_stays_private(folder):
    fvi("run", "small.yaml", "-q", code=0)
    Path(FILE).chmod(0o600)
    fvi("run", "small.yaml", "-q", "--set", "ladder.steps=[4]", code=0)
    assert Path(FILE).stat().st_mode & 0o777 == 0o600
