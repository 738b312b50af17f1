"""Files of samples: what they declare is bounded, numbers are whole words, each is read once."""

import base64
import zlib

import numpy as np
import pytest
from scipy.io import mmwrite
from scipy.sparse import coo_array, eye_array

from fvi_cli.config import load_config
from fvi_cli.scenes import forces
from fvi_cli.scenes.records import csv_samples, data_files
from fvi_cli.scenes.records.csv_samples import read_at2_samples, read_csv_samples
from fvi_cli.scenes.records.data_files import DataFileError, samples_from_text
from fvi_cli.scenes.structures import matrix_keys

AT2 = "A\nB\nC\n{}\n 1.0 2.0\n 3.0 4.0\n"
LINE = "NPTS= 4, DT= .0050 SEC"


def refused(read, path, content, *columns):
    """What is said of a file, which must be no more than some words."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    with pytest.raises(DataFileError) as caught:
        read(path, "f", *columns)
    message = str(caught.value)
    assert message.startswith("f:")
    assert len(message) < 400
    return message


def test_headers_of_at2_are_bounded(tmp_path):
    path = tmp_path / "f.at2"
    path.write_text(AT2.format(LINE))
    assert np.array_equal(read_at2_samples(path, "f").values, [1.0, 2.0, 3.0, 4.0])
    for header in (
        f"NPTS= {'9' * 5000}, DT= .005",
        f"NPTS= {'9' * 200}, DT= .005",
        "NPTS= 4, DT= 1e999",
        "NPTS= 4, DT= 1e308",
        "NPTS= 4, DT= 1e-30",
        "NPTS= 4, DT= 0",
        "NPTS= 1_0, DT= .005",
        "NPTS= 1, DT= .005",
        "NPTS= 3, DT= .005",
        "NPTS= 5, DT= .005",
        "1" * 5000 + " .005 NPTS, DT",
        # in a pattern that looks for digits or blanks at every place, these take minutes
        "1" * 200_000,
        "NPTS=" + " " * 200_000,
        "NPTS= 4" + " " * 200_000,
        "1 " * 100_000,
        "NPTS" * 50_000,
    ):
        refused(read_at2_samples, path, AT2.format(header))


def test_numbers_are_whole_words(tmp_path):
    path = tmp_path / "f.at2"
    for word in ("1_0", "nan", "inf", "1e999", "1,5", "0x1", "\xb2"):
        said = refused(read_at2_samples, path, AT2.format(LINE).replace("3.0", word))
        assert said.startswith("f:6: ")
    csv = tmp_path / "f.csv"
    for word in ("1_0", "nan", "1e999", "0x1"):
        content = f"t,a\n0,1\n1,{word}\n"
        assert refused(read_csv_samples, csv, content, "t", "a").startswith("f:3: ")


def test_lines_are_counted_before_they_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(data_files, "MOST_LINES", 100)
    for end in (b"\n", b"\r", b"\r\n"):
        content = b"t,a" + end + b"0,1" + end + b"1,2"
        for columns, name, read in (
            (("t", "a"), "f.csv", read_csv_samples),
            ((), "f.at2", read_at2_samples),
        ):
            said = refused(read, tmp_path / name, content + 99 * end, *columns)
            assert said.startswith("f: more than 100 lines; thin it out")
            (tmp_path / name).write_bytes(content + 98 * end)
            # carriage returns alone end no line of a CSV file
            if columns and end != b"\r":
                assert read(tmp_path / name, "f", *columns).values.tolist() == [1.0, 2.0]


def test_a_text_of_samples_is_bounded_in_lines_as_well():
    for content in (b"\n" * 100_001, b"1,1\n" * 100_001, b"1,2,3\n", b"1,1\n2\n", b"1\xff,2\n"):
        text = base64.b64encode(zlib.compress(content)).decode()
        with pytest.raises(ValueError, match="not samples as text: "):
            samples_from_text(text)


def counted(monkeypatch, module, name):
    real, calls = getattr(module, name), []

    def counting(*arguments):
        calls.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(module, name, counting)
    return calls


CONFIG = """\
name: swept
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.1}]
  forcing: FORCE
  final_time: 1.0
  exact: none
method: {rk: gauss, degree: 2}
ladder: {steps: [8]}
sweep: {problem.forcing.scale: {from: 1.0, to: 2.0, number: 12}}
"""


@pytest.mark.parametrize("ending", ["csv", "at2"])
def test_a_sweep_reads_its_samples_once(tmp_path, monkeypatch, ending):
    calls = counted(monkeypatch, forces, f"read_{ending}_samples")
    (tmp_path / "f.csv").write_text("t,a\n0,1\n1,2\n")
    (tmp_path / "f.at2").write_text(AT2.format("NPTS= 4, DT= .5"))
    columns = ", column: a" * (ending == "csv")
    path = tmp_path / "swept.yaml"
    path.write_text(CONFIG.replace("FORCE", f"{{file: f.{ending}{columns}}}"))
    (experiment,) = load_config(path).experiments
    scales = [member.values["problem.forcing.scale"] for member in experiment.members]
    assert np.array_equal(scales, np.linspace(1.0, 2.0, 12))
    assert len(calls) == 1
    # another configuration reads it again: the file may be another one
    load_config(path)
    assert len(calls) == 2


def test_a_sweep_reads_every_column_that_it_names(tmp_path):
    (tmp_path / "f.csv").write_text("t,a,b\n0,1,5\n1,2,7\n")
    path = tmp_path / "swept.yaml"
    several = "[{file: f.csv, column: a}, {file: f.csv, column: b}]"
    text = CONFIG.replace("FORCE", "{file: f.csv, column: a}").partition("sweep:")[0]
    path.write_text(f"{text}sweep: {{problem.forcing: {several}}}\n")
    (experiment,) = load_config(path).experiments
    contents = [member.values["problem.forcing"]["content"] for member in experiment.members]
    values = [samples_from_text(content)[1].tolist() for content in contents]
    assert values == [[1.0, 2.0], [5.0, 7.0]]


def test_a_matrix_that_stands_in_several_places_is_read_once(tmp_path, monkeypatch):
    calls = counted(monkeypatch, matrix_keys, "read_matrix")
    mmwrite(tmp_path / "K.mtx", coo_array(eye_array(40)))
    (tmp_path / "s.yaml").write_text(
        "name: s\n"
        "problem: {kind: structure, mass: {file: K.mtx}, stiffness: {file: K.mtx}, "
        "damping: [{order: 0.5, coefficient: {file: K.mtx}}], initial: {}, final_time: 1.0, "
        "exact: none}\n"
        "method: {rk: gauss, degree: 2}\n"
        "ladder: {steps: [8]}\n"
    )
    (experiment,) = load_config(tmp_path / "s.yaml").experiments
    assert np.array_equal(experiment.problem.scene.potential.stiffness, np.eye(40))
    assert len(calls) == 1


def test_no_number_of_a_header_is_cut_off(tmp_path):
    path = tmp_path / "f.at2"
    for behind in range(12):
        named = "NPTS= 4, DT= .0123"
        line = named.rjust(csv_samples.LONGEST_LINE + behind)
        if behind:
            assert "NPTS= and DT= are missing" in refused(read_at2_samples, path, AT2.format(line))
        else:
            path.write_text(AT2.format(line))
            assert read_at2_samples(path, "f").time[1] == 0.0123
