"""What stands under `content` in place of a file is held to the file, and to its own digest."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib

import numpy as np
import pytest
from scipy.io import mmwrite
from scipy.sparse import coo_array, eye_array

from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError

CSV = "t,a\n0.0,0.0\n0.5,1.0\n1.0,-0.1\n2.0,4.0\n"
STIFFNESS = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
SOURCE = {
    "name": "held",
    "problem": {
        "kind": "structure",
        "mass": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "final_time": 1.0,
    },
    "method": {"rk": "gauss", "degree": 2},
    "ladder": {"steps": [8]},
}


@pytest.fixture(params=["samples", "dense", "sparse"])
def written(request, tmp_path):
    """A configuration with the content of a file, the mapping that holds it, and the file."""
    source = json.loads(json.dumps(SOURCE))
    problem, kind = source["problem"], request.param
    problem["stiffness"] = STIFFNESS.tolist()
    if kind == "samples":
        (tmp_path / "a.csv").write_text(CSV)
        problem["forcing"] = [{"file": "a.csv", "column": "a"}, 0.0, 0.0]
    elif kind == "dense":
        np.save(tmp_path / "K.npy", STIFFNESS)
        problem["stiffness"] = {"file": "K.npy"}
    else:
        mmwrite(tmp_path / "K.mtx", coo_array(STIFFNESS + eye_array(3)))
        problem["stiffness"] = {"file": "K.mtx"}
    (tmp_path / "c.yaml").write_text(json.dumps(source))
    resolved = load_config(tmp_path / "c.yaml").experiments[0].problem_specification
    source["problem"] |= json.loads(json.dumps(resolved))
    problem = source["problem"]
    held = problem["forcing"][0] if kind == "samples" else problem["stiffness"]
    return source, held, tmp_path


def falsified(text: str, which: int) -> str:
    """The content with one number that is another, packed as a sound one is."""
    *header, packed = text.split(" ")
    content = bytearray(zlib.decompress(base64.b64decode(packed)))
    if header:
        # the last of the entries, which stand at the end
        numbers = np.frombuffer(bytes(content[-8:]), dtype="<f8") + 10.0**-which
        content[-8:] = numbers.astype("<f8").tobytes()
    else:
        content = bytearray(bytes(content).replace(b"4.0", f"4.{which}".encode()))
    return " ".join([*header, base64.b64encode(zlib.compress(bytes(content), 9)).decode()])


def read(source, folder):
    (folder / "again.yaml").write_text(json.dumps(source))
    return load_config(folder / "again.yaml")


@pytest.mark.parametrize("which", [1, 3, 9])
def test_a_falsified_digit_is_refused(written, which):
    source, held, folder = written
    sound = held["content"]
    # the control: what was written is read, with the file and its digest and without
    before = read(source, folder).resolved
    held["content_sha256"] = hashlib.sha256(sound.encode()).hexdigest()
    assert read(source, folder).resolved == before
    held["content"] = falsified(sound, which)
    with pytest.raises(ConfigError, match=r"content: it has changed: its sha256 is"):
        parse_config(json.dumps(source), "stored")
    del held["content_sha256"]
    with pytest.raises(ConfigError, match=r"content: not what [aK]\.\w+ holds; leave it out"):
        read(source, folder)
    # another file by that name says nothing
    path = folder / held["file"]
    path.write_text("other")
    read(source, folder)
    path.unlink()
    read(source, folder)


def test_what_is_cut_off_or_flipped_is_refused(written):
    source, held, folder = written
    (folder / held["file"]).unlink()
    *header, packed = held["content"].split(" ")
    raw = base64.b64decode(packed)
    flipped = bytearray(raw)
    flipped[-2] ^= 1
    for wrong in (raw[:-4], raw[:-1], raw + b"more", bytes(flipped)):
        held["content"] = " ".join([*header, base64.b64encode(wrong).decode()])
        with pytest.raises(ConfigError, match=r"content|not samples as text"):
            read(source, folder)
