"""Nothing is taken from a file that is not as it was written, whoever reads it."""

import os
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import fvi
from spread import spread

from fvi_cli.errors import StorageError
from fvi_cli.storage import list_runs, result_file
from fvi_cli.storage import stream as seal
from fvi_cli.storage.export import export_file
from fvi_cli.storage.files import CACHE_BYTES, open_stored
from fvi_cli.storage.stream import SealedStream

CONFIG = """\
name: quick
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0, exact: cos(t)}
method: {bdf: 2, sampling: nodes}
ladder: {steps: [4, 8]}
"""
GROUP = "quick/bdf2-nodes-s1-gauss1-none/n000008"
FILE = "results/quick.h5"
READERS = (
    ("show", FILE),
    ("convergence", FILE, "--output", "made"),
    ("plot", FILE, "--output", "made"),
    ("export", FILE, "--to", "npz", "--output", "made"),
    ("run", "quick.yaml"),
)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of results as it is written."""
    folder = tmp_path_factory.mktemp("written")
    (folder / "quick.yaml").write_text(CONFIG)
    fvi("run", str(folder / "quick.yaml"), "-o", str(folder), code=0)
    return (folder / "quick.h5").read_bytes()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: bytes) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick.yaml").write_text(CONFIG)
    (tmp_path / "results").mkdir()
    (tmp_path / FILE).write_bytes(written)
    return tmp_path


def smaller_error(file: h5py.File) -> None:
    file[GROUP].attrs["error"] = 1e-30


def other_status(file: h5py.File) -> None:
    file[GROUP].attrs["status"] = "floor"


def other_norm(file: h5py.File) -> None:
    file[GROUP].attrs["norm"] = "final"


def one_attribute_more(file: h5py.File) -> None:
    file[GROUP].attrs["checked"] = "yes"


@spread(few=2, reader=READERS, change=[smaller_error, other_status, other_norm, one_attribute_more])
def test_a_changed_attribute_is_noticed_by_every_reader(change, reader):
    assert fvi(*reader).exit_code == 0  # control
    with h5py.File(FILE, "r+") as file:
        change(file)
    before = Path(FILE).read_bytes()
    result = fvi(*reader, code=2)
    assert "is not what was written" in result.stderr
    assert Path(FILE).read_bytes() == before


def changed_numbers(file: h5py.File) -> None:
    file[GROUP]["position"][3, 0] += 1e-12


def changed_times(file: h5py.File) -> None:
    file[GROUP]["time"][3] += 1e-12


def external(file: h5py.File) -> None:
    Path("secret").write_bytes(np.arange(9.0).tobytes())
    del file[GROUP]["position"]
    file[GROUP].create_dataset("position", (9, 1), dtype="<f8", external=[("secret", 0, 72)])


def link_elsewhere(file: h5py.File) -> None:
    del file[GROUP]["position"]
    file[GROUP]["position"] = h5py.ExternalLink("other.h5", "/x")


def soft_link(file: h5py.File) -> None:
    del file[GROUP]["position"]
    file[GROUP]["position"] = h5py.SoftLink("/quick")


def group_elsewhere(file: h5py.File) -> None:
    file["quick/other"] = h5py.ExternalLink("other.h5", "/x")


def odd_type(file: h5py.File) -> None:
    del file[GROUP]["position"]
    file[GROUP].create_dataset("position", data=np.zeros((9, 1), dtype=[("a", "<f4")]))


def enormous(file: h5py.File) -> None:
    del file[GROUP]["position"]
    file[GROUP].create_dataset("position", shape=(2**40, 2**20), dtype="<f8", chunks=(1024, 1))


def a_group_more(file: h5py.File) -> None:
    file.create_group(f"{GROUP}/inner")


STRANGE = [
    changed_numbers,
    changed_times,
    external,
    link_elsewhere,
    soft_link,
    group_elsewhere,
    odd_type,
    enormous,
    a_group_more,
]


@pytest.mark.few(4)
@pytest.mark.parametrize("change", STRANGE)
def test_what_was_not_written_by_us_is_refused_by_all_who_read_numbers(change):
    with h5py.File(FILE, "r+") as file:
        change(file)
    for reader in READERS[1:]:
        result = fvi(*reader)
        assert result.exit_code == 2, (reader, result.output)
        assert f"{FILE}: is damaged or not a result file" in result.stderr


def test_the_root_is_verified():
    with h5py.File(FILE, "r+") as file:
        file.attrs["resolved_config"] = file.attrs["resolved_config"].replace("cos(t)", "sin(t)")
    for reader in READERS[:3]:
        result = fvi(*reader, code=2)
        assert "the attributes of the file are not those that were written" in result.stderr


def test_nothing_from_a_file_steers_the_terminal():
    with h5py.File(FILE, "r+") as file:
        file[GROUP].attrs["\x1b[2J"] = "x"
        file["\x1b]0;title\x07"] = 1.0
        file.attrs["creator"] = "fvi-cli"
    for reader in READERS:
        assert "\x1b" not in fvi(*reader).output


def test_a_pipe_in_the_place_of_a_file_does_not_hang():
    Path(FILE).unlink()
    os.mkfifo(FILE)
    for reader in READERS:
        result = fvi(*reader, code=2)
        assert "is a device or pipe" in result.stderr


def test_an_older_format_is_told_what_to_do():
    with h5py.File(FILE, "r+") as file:
        file.attrs["format"] = 1
    for reader in READERS:
        result = fvi(*reader, code=2)
        assert "has format 1, this version of fvi reads 3; move the file away" in result.stderr


# --- the seal -------------------------------------------------------------------------------------


def test_every_flipped_bit_of_a_sealed_file_is_noticed_where_it_is_read(tmp_path):
    path = tmp_path / "sealed"
    content = bytes(range(256)) * 3 * (seal.BLOCK // 256) + b"rest"
    path.write_bytes(content)
    with path.open("r+b") as file:
        seal.append_seal(file.fileno())
    sealed = path.read_bytes()
    assert len(sealed) == len(content) + seal.length_of(len(content))
    stream = SealedStream(path)
    assert stream.read(10**9) == content
    stream.seek(-4, 2)
    assert stream.read(9) == b"rest"
    stream.close()
    for place in (0, seal.BLOCK, 2 * seal.BLOCK - 1, len(content) - 1):
        path.write_bytes(sealed[:place] + bytes([sealed[place] ^ 1]) + sealed[place + 1 :])
        stream = SealedStream(path)
        # what is elsewhere can be read
        block = place // seal.BLOCK
        other = (block + 1) % 4 * seal.BLOCK
        stream.seek(other)
        assert stream.read(4) == content[other : other + 4]
        stream.seek(block * seal.BLOCK)
        with pytest.raises(ValueError, match="not those that were written"):
            stream.read(1)
        stream.close()
    for place in range(len(content) + len(seal.MARK), len(sealed), 7):
        path.write_bytes(sealed[:place] + bytes([sealed[place] ^ 1]) + sealed[place + 1 :])
        with pytest.raises(ValueError, match="not those that were written"):
            SealedStream(path)


def test_a_listing_of_a_large_file_does_not_read_all_of_it(monkeypatch):
    arguments = ("run", "quick.yaml", "--set", "ladder.steps=[100000]", "--fresh", "-q")
    fvi(*arguments, code=0)
    blocks = -(-Path(FILE).stat().st_size // seal.BLOCK)
    looked_at: set[int] = set()
    real = SealedStream._look_at

    def counted(self, own, number):
        looked_at.add(number)
        real(self, own, number)

    monkeypatch.setattr(SealedStream, "_look_at", counted)
    fvi("show", FILE, code=0)
    assert len(looked_at) < blocks / 2
    looked_at.clear()
    fvi("export", FILE, "--to", "npz", code=0)
    assert len(looked_at) == blocks


def test_a_listing_opens_no_group(monkeypatch):
    whole = asdict(list_runs(Path(FILE)))
    assert len(whole["runs"]) > 1
    opened = []
    real = result_file.StoredGroup
    monkeypatch.setattr(result_file, "StoredGroup", lambda one: opened.append(one) or real(one))
    assert asdict(list_runs(Path(FILE))) == whole
    assert not opened
    # control: where another program was at work every group is looked at, and says the same
    with h5py.File(FILE, "r+") as file:
        file.attrs.modify("format", file.attrs["format"])
    assert asdict(list_runs(Path(FILE))) == whole
    assert len(opened) >= len(whole["runs"])


def test_a_listing_tells_of_a_damaged_block(tmp_path):
    content = bytearray(Path(FILE).read_bytes())
    content[content.index(b'"case": "') + 9] ^= 1
    Path(FILE).write_bytes(content)
    with pytest.raises(StorageError, match="its bytes are not those that were written"):
        list_runs(Path(FILE))


def test_every_changed_byte_of_the_head_of_a_file_is_told_as_damage(folder):
    content = bytearray((folder / FILE).read_bytes())
    # without the seal it is the library that reads them: sizes and addresses of any length
    del content[content.rfind(seal.MARK) :]
    complaints = []
    for place in range(8, 56):
        (folder / FILE).write_bytes(bytes([*content[:place], 0xFE, *content[place + 1 :]]))
        try:
            list_runs(folder / FILE)
        except StorageError as error:
            complaints.append(str(error))
    assert len(complaints) > 30
    assert all(f"{FILE}: " in complaint for complaint in complaints)


def test_the_library_keeps_little_of_an_open_file(folder):
    with open_stored(folder / FILE) as (_, file):
        assert file.id.get_mdc_config().max_size == CACHE_BYTES


def test_what_a_file_says_of_the_axes_of_its_arrays_is_not_believed(folder):
    with h5py.File(FILE, "r+") as file:
        for place in (GROUP, GROUP.replace("08", "04")):
            for name in ("time", "position"):
                for attribute in list(file[place][name].attrs):
                    del file[place][name].attrs[attribute]
    (csv, *_) = sorted(export_file(folder / FILE, "csv", folder / "made"))
    assert csv.read_text().startswith("time,x,p_x,energy\n0.0,1.0,")
