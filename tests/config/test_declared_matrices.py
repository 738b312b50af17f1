"""What a file declares of a matrix is checked before memory is taken or a library sees it."""

import io

import numpy as np
import pytest
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, dia_array
from scipy.sparse import save_npz as save

from fvi_cli.scenes.records.inputs import DataFileError
from fvi_cli.scenes.records.matrices import MOST_ROWS, read_matrix

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
    """Some entries of every array of indices replaced by ones that lie outside."""
    for name in ("indptr", "indices", "row", "col"):
        for wrong in (LARGE, -5 - N) if name in parts else ():
            changed = parts[name].copy()
            changed[len(changed) // 2] = wrong
            yield {**parts, name: changed}
    for shape in ([LARGE, LARGE], [N, LARGE], [N, N, N]):
        yield {**parts, "shape": np.array(shape)}
    yield {**parts, "format": np.array("none")}


@pytest.mark.parametrize("kind", SPARSE)
def test_no_index_of_a_sparse_file_lies_outside(tmp_path, kind):
    path, parts = tmp_path / "K.npz", parts_of(kind)
    np.savez(path, **parts)
    assert np.array_equal(read_matrix(path, "K").toarray(), FULL)
    for changed in changes(parts):
        np.savez(path, **changed)
        with pytest.raises(DataFileError, match=r"^K: "):
            read_matrix(path, "K")


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
    for number in ("1_0", "1,5", "1.0x"):
        text = f"{coordinates}% of M_1, by D\n1 1 1\n1 1 {number}\n"
        refused("K.mtx", text.encode(), "K:4: '[_,x]' is not allowed; numbers are written like")
    refused("K.csv", b"1_0", "K: not a readable .csv file: .*'1_0'")
    refused("K.csv", b"\n" * 1_000_001, "K: more than 1000000 lines")
    refused("K.npy", b"no array", "not a readable .npy file")
    refused("K.npz", b"no array", "not a readable .npz file")
    refused("K.mat", b"no matrix", "not a readable .mat file")
    np.save(tmp_path / "K.npy", np.array([{"a": 1}]), allow_pickle=True)
    with pytest.raises(DataFileError, match=r"not a readable \.npy file"):
        read_matrix(tmp_path / "K.npy", "K")


def test_a_file_of_matlab_7_3_is_named(tmp_path):
    (tmp_path / "K.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(DataFileError, match=r"a \.mat file of MATLAB 7\.3; save it with -v7"):
        read_matrix(tmp_path / "K.mat", "K")
