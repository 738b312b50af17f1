"""What a file declares of a matrix is checked before memory is taken or a library sees it."""

import io
import struct
import zipfile
import zlib

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, dia_array, diags_array
from scipy.sparse import save_npz as save

from fvi_cli.scenes.records.data_files import DataFileError
from fvi_cli.scenes.structures.declared import MOST_ROWS
from fvi_cli.scenes.structures.matrix_files import read_matrix

N = 40
FULL = np.diag(np.full(N, 2.0)) - np.diag(np.ones(N - 1), 1) - np.diag(np.ones(N - 1), -1)
SPARSE = {
    "csr": csr_array(FULL),
    "csc": csc_array(FULL),
    "coo": coo_array(FULL),
    "dia": dia_array(FULL),
    "bsr": bsr_array(FULL, blocksize=(2, 4)),
}
LARGE = 10**9


def parts_of(kind):
    """What SciPy keeps of a matrix in a file."""
    buffer = io.BytesIO()
    save(buffer, SPARSE[kind])
    with np.load(io.BytesIO(buffer.getvalue())) as found:
        return dict(found)


def changes(parts):
    """Every entry of every array of indices replaced by one that lies outside; other lengths."""
    for name in ("indptr", "indices", "row", "col", "offsets"):
        if name not in parts:
            continue
        for place in (0, 1, len(parts[name]) // 2, -1):
            for wrong in (LARGE, -5 - N, 2**31 - 1):
                changed = parts[name].copy()
                changed[place] = wrong
                yield {**parts, name: changed}
        yield {**parts, name: parts[name][:-1]}
        yield {**parts, name: np.append(parts[name], 0).astype(np.int32)}
        yield {**parts, name: parts[name].astype(float)}
        yield {**parts, name: parts[name].reshape(1, -1)}
        yield {key: value for key, value in parts.items() if key != name}
    for shape in ([LARGE, LARGE], [N, LARGE], [-1, -1], [0, 0], [N], [N, N, N], ["a", "b"]):
        yield {**parts, "shape": np.array(shape)}
    yield {**parts, "format": np.array("none")}
    yield {**parts, "data": parts["data"].astype(str)}
    yield {**parts, "data": parts["data"].ravel()[:-1]}


@pytest.mark.parametrize("kind", SPARSE)
def test_no_index_of_a_sparse_file_lies_outside(tmp_path, kind):
    path, parts = tmp_path / "K.npz", parts_of(kind)
    np.savez(path, **parts)
    assert np.array_equal(read_matrix(path, "K").toarray(), FULL)
    for changed in changes(parts):
        np.savez(path, **changed)
        with pytest.raises(DataFileError, match=r"^K: "):
            read_matrix(path, "K")


def element(kind, data):
    padding = bytes(-len(data) % 8)
    return struct.pack("<II", kind, len(data)) + data + padding


def mat(mclass, dims, *arrays, name=b"K", compressed=False, nzmax=9):
    """A file of MATLAB's version 5 with one matrix."""
    inner = (
        element(6, struct.pack("<II", mclass, nzmax))
        + element(5, np.array(dims, "<i4").tobytes())
        + element(1, name)
        + b"".join(arrays)
    )
    matrix = struct.pack("<II", 14, len(inner)) + inner
    if compressed:
        packed = zlib.compress(matrix, 9)
        matrix = struct.pack("<II", 15, len(packed)) + packed
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + matrix


def test_sizes_that_are_declared_are_bounded(tmp_path):
    def refused(name, content, message):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(DataFileError, match=message):
            read_matrix(path, "K")

    market = "%%MatrixMarket matrix {} real general\n"
    coordinates = market.format("coordinate")
    for rows in (MOST_ROWS + 1, 9_000_000, 2_000_000_000):
        text = f"{coordinates}{rows} {rows} 1\n1 1 2.0\n"
        refused("K.mtx", text.encode(), f"K: it has {rows} rows; a sparse matrix may have 300000")
    refused("K.mtx", f"{coordinates}3 3 1000000000\n1 1 2\n".encode(), "entries are declared")
    array = market.format("array")
    refused("K.mtx", f"{array}40000 40000\n1\n".encode(), "1600000000 entries are declared")
    integers = coordinates.replace("real", "integer")
    refused("K.mtx", f"{integers}1 1 1\n1 1 {2**70}\n".encode(), "not a readable .mtx file")
    # the library reads all of these as 1
    for number in ("1_0", "1,5", "1D5", "1.0x"):
        text = f"{coordinates}% of M_1, by D\n1 1 1\n1 1 {number}\n"
        refused("K.mtx", text.encode(), "K:4: '[_,Dx]' is not allowed; numbers are written like")
    refused("K.csv", b"1_0", "K:1: '1_0' is not a number")
    refused("K.csv", b"\n" * 1_000_001, "K: more than 1000000 lines")
    header = np.lib.format.magic(1, 0) + struct.pack("<H", 118)
    shape = "{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000), }"
    refused("K.npy", header + shape.ljust(117).encode() + b"\n" + bytes(80), "80 bytes are there")
    refused("K.npz", zipped(bytes(200_000_000)), "unpacks to more than 32 MB")
    refused("K.npz", zipped(b"", zipfile.ZIP_LZMA), "compressed in another way than NumPy does")
    zeros = element(9, bytes(40_000_000))
    refused("K.mat", mat(6, (1, 5_000_000), zeros, compressed=True), "unpacks to more than 32 MB")
    refused("K.npz", encrypted(), "encrypted")
    refused("K.npz", zipped(b"no array"), "not a readable .npz file")


def zipped(content, how=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", how) as archive:
        archive.writestr("K.npy", content)
    return buffer.getvalue()


def encrypted():
    content = bytearray(zipped(b"secret"))
    content[content.index(b"PK\x01\x02") + 8] |= 1
    return bytes(content)


def test_the_large_ones_of_every_kind_stay_readable(tmp_path):
    rows = 5000
    matrix = diags_array(
        [np.ones(rows - 1), np.full(rows, 4.0), np.ones(rows - 1)], offsets=(-1, 0, 1)
    )
    for compressed in (True, False):
        savemat(tmp_path / "K.mat", {"K": csc_array(matrix)}, do_compression=compressed)
        form = read_matrix(tmp_path / "K.mat", "K")
        assert abs(form - csr_array(matrix)).max() == 0
    savemat(tmp_path / "K.mat", {"K": csc_array(FULL), "L": FULL}, format="4")
    for variable in "KL":
        form = read_matrix(tmp_path / "K.mat", "K", variable)
        assert np.array_equal(form.toarray() if variable == "K" else form, FULL)
