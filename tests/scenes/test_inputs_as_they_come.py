"""Records, tables and matrices as instruments and programs write them, and what is refused."""

import re

import numpy as np
import pytest
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, save_npz

import fvi_cli as fvi
from fvi_cli.effects.matrices import dense
from fvi_cli.scenes.records.csv_samples import read_at2_samples, read_csv_columns, read_csv_samples
from fvi_cli.scenes.records.inputs import DataFileError
from fvi_cli.scenes.records.matrices import read_matrix

NUMBERS = "1.000000E-02  -2.000000E-02  3.000000E-02\n2.000000E-02  -3.000000E-02  0.000000E+00\n"
VALUES = [0.01, -0.02, 0.03, 0.02, -0.03, 0.0]
UNITS = "ACCELERATION TIME HISTORY IN UNITS OF G\n"
HEADS = {
    "named": f"PEER STRONG MOTION\nIMPERIAL VALLEY\n{UNITS}NPTS=  6, DT= .01000 SEC\n",
    "before": f"PEER NGA RECORD\nCORINTH EQ\n{UNITS}6    0.0100    NPTS, DT\n",
    "no blanks": f"  PEER\n  FRIULI\n  {UNITS}  NPTS=6,    DT=0.0100SEC\n",
    "three lines": f"PEER\n{UNITS}NPTS= 6, DT= .01000 SEC\n",
    "five lines": f"PEER. PROCESSING BY\nTHE AUTHOR\nEL CENTRO\n{UNITS}NPTS= 6, DT= .01000 SEC\n",
}


@pytest.fixture
def file_of(tmp_path):
    def write(text, name="record.AT2"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path, name

    return write


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_headers_of_records(file_of, head, ends):
    found = read_at2_samples(*file_of((HEADS[head] + NUMBERS).replace("\n", ends)))
    assert found[:, 1].tolist() == VALUES
    assert found[:, 0].tolist() == [0.0, 0.01, 0.02, 0.03, 0.04, 0.05]


@pytest.mark.parametrize("seed", range(4))
def test_numbers_in_fixed_columns_touch(file_of, seed):
    values = np.random.default_rng(seed).uniform(-0.5, 0.5, 23)
    head = f"PEER\nEQ\n{UNITS}NPTS= 23, DT= .01 SEC\n"
    rows = [values[k : k + 5] for k in range(0, 23, 5)]
    glued = "\n".join("".join(f"{one:14.7E}" for one in row) for row in rows)
    assert re.search(r"\d-", glued)
    spaced = "\n".join("  ".join(f"{one:.7E}" for one in row) for row in rows)
    found, known = (read_at2_samples(*file_of(head + one)) for one in (glued, spaced))
    assert np.array_equal(found, known)
    # numbers that touch without a sign could be cut in several ways
    with pytest.raises(DataFileError, match=r"AT2:5: .* is not a finite number"):
        read_at2_samples(*file_of(head + glued.replace(" ", "").replace("-0.", "0.")))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADS["named"].replace("ACCELERATION", "VELOCITY") + NUMBERS, "AT2:3: .*the velocity of"),
        (HEADS["named"].replace("ACCELERATION", "DISPLACEMENT") + NUMBERS, "the displacement of"),
        (
            NUMBERS + HEADS["named"],
            "NPTS= and DT= are missing in the first 5 lines",
        ),
        ("Origin Time       2011/03/11 14:46:00\nLat. 38.1\n", "format of K-NET"),
        ("Corrected acceleration (COSMOS format v1.2)\n", "format of COSMOS"),
        (HEADS["named"] + NUMBERS.partition("\n")[0], "3 accelerations where .*NPTS = 6"),
        (HEADS["named"] + NUMBERS * 2, "12 accelerations where"),
        (HEADS["named"] + NUMBERS.replace("3.0", "x"), "AT2:5: 'x00000E-02' is not"),
    ],
)
def test_other_records_are_refused(file_of, text, words):
    with pytest.raises(DataFileError, match=words):
        read_at2_samples(*file_of(text))


TABLES = {
    "plain": "t,a\n0.0,1.5\n0.1,-2.5e-1\n",
    "instrument": "#Oscilloscope\n#Serial: 0\n\nt,a\n0.0,1.5\n0.1,-0.25\n",
    "machine": "Specimen,Mount 7\nRate,50 mm/min\nt,a\n(s),(N)\n0.0,1.5\n0.1,-0.25\n",
    "units": "t;a\ns;m/s^2\n0.0;1.5\n0.1;-0.25\n",
    "tabs, DOS, BOM": "\ufefft\ta\r\n0.0\t1.5\r\n0.1\t-0.25\r\n",
    "other columns": "who,t,a\nme,0.0,1.5\nyou,0.1,-0.25\n",
    "quoted": 't,a\n"0.0","1.5"\n"0.1","-0.25"\n',
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_instruments(file_of, name):
    found, _ = read_csv_samples(*file_of(TABLES[name], "a.csv"), "t", "a")
    assert found.tolist() == [[0.0, 1.5], [0.1, -0.25]]


@pytest.mark.parametrize(
    "text",
    [
        "Zeit [s];Weg, gefiltert [mm]\n0,00;0,4350\n0,05;-0,4237\n",
        'Zeit [s],"Weg, gefiltert [mm]"\n"0,00","0,4350"\n"0,05","-0,4237"\n',
    ],
)
def test_decimal_commas_are_read_where_they_are_said(file_of, text):
    given = file_of(text, "a.csv")
    columns = ("Zeit [s]", "Weg, gefiltert [mm]")
    found, _ = read_csv_samples(*given, *columns, decimal=",")
    assert found.tolist() == [[0.0, 0.435], [0.05, -0.4237]]
    with pytest.raises(DataFileError, match=r"a\.csv:2: .*write decimal: ','"):
        read_csv_samples(*given, *columns)


@pytest.mark.parametrize(
    ("text", "decimal", "words"),
    [
        ("t;x\n0.00;4,350,000.0\n0.05;4,237,000.0\n", ".", "a.csv:2: .*'4,350,000.0'"),
        ("t;x\n0,00;4.350,5\n0,05;4.237,0\n", ",", "a.csv:2: .*'4.350,5'"),
        ("t,x\n0.000,1\n0.001,2\n0.001,3\n", ".", "a.csv:4: t = 0.001 is the time of line 3"),
        ("t,x\n0.0,1\n0.2,2\n0.1,3\n", ".", "a.csv:4: t = 0.1 is before the 0.2 of line 3"),
        ("t,x\n0.0,1\n0.1,NaN\n0.2,\n", ".", "a.csv:3: column 'x' holds 'NaN'"),
        ("t,x\n0.0,1\n0.1,2\n0.2,\n", ".", "a.csv:4: column 'x' holds ''"),
        ("t,x\n0,5,1.2\n", ".", "a.csv:2: 3 cells, but 2 names"),
        ("t,y\n0,5\n1,2\n", ".", "a.csv:1: no columns are called 'x'"),
        ("t,x\nnan,nan\n0,1\n", ".", "a.csv:2: "),
        ("t,x\n", ".", "no samples"),
        ("", ".", "a.csv:1: the file is empty"),
        ("t,x\n0,\xe9\n".encode("latin-1"), ".", "a.csv:2: not UTF-8"),
        (b"PK\x03\x04....", ".", "a spreadsheet; save it as CSV"),
    ],
)
def test_what_cannot_be_read_exactly_is_refused_with_its_line(file_of, text, decimal, words):
    with pytest.raises(DataFileError, match=words):
        read_csv_samples(*file_of(text, "a.csv"), "t", "x", decimal=decimal)


def test_a_column_of_labels_is_no_hindrance(file_of):
    given = file_of("storey,mass\nroof,2.0\nfirst,3.0\n", "building.csv")
    assert read_csv_columns(*given, ("mass",))[0][:, 0].tolist() == [2.0, 3.0]


CHAIN = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
ENTRIES = "3 3 5\n1 1 2.0\n2 1 -1.0\n2 2 2.0\n3 2 -1.0\n3 3 1.0\n"
BANNER = "%%MatrixMarket matrix coordinate real symmetric\n"
MARKETS = {
    "plain": BANNER + ENTRIES,
    "blanks": f"{BANNER}  % from a Fortran program\n{ENTRIES}".replace("\n1", "\n   1"),
    "fortran": BANNER + re.sub(r"(\.0)\n", r"\1D+00\n", ENTRIES),
    "array": "%%MatrixMarket matrix array real symmetric\n3 3\n2.\n-1.\n0.\n2.\n-1.\n1.\n",
    "repeated": BANNER + ENTRIES.replace("3 3 5", "3 3 6").replace("1 1 2.0", "1 1 1.0\n1 1 1.0"),
}


@pytest.mark.parametrize("name", MARKETS)
def test_matrices_of_finite_element_programs(file_of, name):
    assert dense(read_matrix(*file_of(MARKETS[name], "K.mtx"))).tolist() == CHAIN


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        (BANNER + ENTRIES.replace("2.0", "2,0"), "K.mtx", "K.mtx:3: ',' is not allowed"),
        (f"{BANNER}% of M_1\n{ENTRIES}".replace("2.0", "2_0"), "K.mtx", "K.mtx:4: '_' is not"),
        ("1_0", "K.csv", "not a readable .csv file: .*'1_0'"),
        (b"no array", "K.npy", "not a readable .npy file"),
        (b"no array", "K.npz", "not a readable .npz file"),
        (b"no matrix", "K.mat", "not a readable .mat file"),
        (BANNER + ENTRIES, "K.mm", "the ending must be one of"),
        (BANNER.lower() + ENTRIES, "K.mtx", "Line 1: Not a Matrix Market file"),
        (BANNER + "3 3 1000000000\n1 1 1.0\n", "K.mtx", "more entries are declared than there"),
        (BANNER + "300001 300001 1\n1 1 1.0\n", "K.mtx", "a matrix may have 300000 rows"),
        ("1 2\n2\n", "K.txt", "not a readable .txt file"),
        ("# nothing\n", "K.csv", "not a readable .csv file"),
        ("1 2\n3 1\n", "K.txt", "mirror image"),
        ("1 nan\nnan 1\n", "K.txt", "every entry must be finite"),
        (b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(64), "K.mat", "7.3.*save it"),
    ],
)
def test_other_matrices_are_refused(file_of, text, name, words):
    with pytest.raises(DataFileError, match=words):
        read_matrix(*file_of(text, name))


@pytest.mark.parametrize("form", [csr_array, csc_array, coo_array, bsr_array])
def test_no_index_of_a_sparse_file_lies_outside(form, tmp_path):
    # it would end the process
    path = tmp_path / "K.npz"
    save_npz(path, form(CHAIN))
    with np.load(path) as found:
        parts = dict(found)
    assert np.array_equal(dense(read_matrix(path, "K")), CHAIN)
    for name in {"indptr", "indices", "row", "col"} & parts.keys():
        for wrong in (10**9, -50):
            changed = parts[name].copy()
            changed[len(changed) // 2] = wrong
            np.savez(path, **{**parts, name: changed})
            with pytest.raises(DataFileError):
                read_matrix(path, "K")


def test_no_object_of_a_file_is_made(tmp_path):
    np.save(tmp_path / "K.npy", np.array([{"a": 1}]), allow_pickle=True)
    with pytest.raises(DataFileError, match=r"not a readable \.npy file"):
        read_matrix(tmp_path / "K.npy", "K")


COMMAS = """\
name: commas
problem:
  kind: structure
  mass: [[2, 0], [0, 1]]
  stiffness: [[4, -1], [-1, 3]]
  ground_acceleration: {file: a.csv, time: t, column: a, decimal: ",", interpolation: previous}
  ground_direction: {file: r.csv}
  final_time: 1.0
ladder: {steps: [10]}
"""


def test_keys_of_tables_and_directions(file_of, tmp_path):
    file_of("t;a\n0,0;1,5\n0,5;-2,5\n1,0;0,0\n", "a.csv")
    file_of("1\n0\n", "r.csv")
    path, _ = file_of(COMMAS, "commas.yaml")
    (experiment,) = fvi.load(path).experiments
    force = experiment.problem.scene.forcing(np.array([0.25, 0.75]))
    assert force.tolist() == [[-3.0, 0.0], [5.0, 0.0]]
    for name, wrong, words in (
        ("r.csv", "1\nx\n", "r.csv: not a list of numbers"),
        ("r.csv", "1 2\n3 4\n", "one line, or one column"),
        ("a.csv", "t;a\n0.0;1.5\n0.5;2.5\n1.0;0\n", "a.csv:2: column 't' holds '0.0'"),
    ):
        file_of("1\n0\n", "r.csv")
        file_of(wrong, name)
        with pytest.raises(fvi.ConfigError, match=words):
            fvi.load(path)
