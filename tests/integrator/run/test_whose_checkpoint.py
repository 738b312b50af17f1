"""A checkpoint is that of one scene, method and mesh: every other run begins at its start."""

import io
from dataclasses import replace

import numpy as np
import pytest
from kept_checkpoints import Kept, StoppedError
from letters import spring, swing

import fvi_cli as fvi
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import graded_mesh, mesh_of, uniform_mesh
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.checkpoint import (
    OF_ANOTHER_RUN,
    arrays_digest,
    fingerprint,
)
from fvi_cli.integrator.run.parts import integrate_part

HEAD = ("label", "seconds", "case", "n_steps", "step_size", "fingerprint", "done", "reported")
N, T = 48, 8.0
METHOD = fvi.Method(cq="gauss", degree=2, start="none", history="exponentials")
SCENE = spring((0.5, 0.7), T=T, k=2.0, x=1.0, v=0.5)
MESH = graded_mesh(T, N, 3.0)
TIMES = np.array([one.begin for one in MESH.stretches] + [T])


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch):
    monkeypatch.setattr(loop, "CHUNK", 16)


def kept_of(scene, method, mesh):
    kept = Kept(stops=[1])
    with pytest.raises(StoppedError):
        integrate(scene, method, mesh, checkpoints=kept)
    return kept.content


def nudged(index, by):
    times = TIMES.copy()
    times[index] *= 1 + by
    return mesh_of(times)


MESHES = {
    "grading 2": graded_mesh(T, N, 2.0),
    "grading 3.0000001": graded_mesh(T, N, 3.0000001),
    "equal steps": uniform_mesh(T, N),
    "one point of the past": nudged(3, 1e-9),
    "one point to come": nudged(N - 3, 1e-9),
}
SCENES = {
    "order": spring((0.5 + 1e-12, 0.7), T=T, k=2.0, x=1.0, v=0.5),
    "coefficient": spring((0.5, 0.7 + 1e-12), T=T, k=2.0, x=1.0, v=0.5),
    "stiffness": spring((0.5, 0.7), T=T, k=2.0 + 1e-12, x=1.0, v=0.5),
    "position": spring((0.5, 0.7), T=T, k=2.0, x=1.0 + 1e-12, v=0.5),
    "velocity": spring((0.5, 0.7), T=T, k=2.0, x=1.0, v=0.5 + 1e-12),
    "kind": swing((0.5, 0.7), T=T, x=1.0, v=0.5),
    "other force": spring((0.5, 0.7), T=T, k=2.0, x=1.0, v=0.5, forcing="sin(2*t)"),
    "force": spring((0.5, 0.7), T=T, k=2.0, x=1.0, v=0.5, forcing="sin(t)"),
}


@pytest.mark.few(6)
@pytest.mark.parametrize(
    ("scene", "method", "mesh"),
    [
        *(pytest.param(SCENE, METHOD, mesh, id=name) for name, mesh in MESHES.items()),
        *(pytest.param(scene, METHOD, MESH, id=name) for name, scene in SCENES.items()),
    ],
)
def test_a_checkpoint_of_another_run_is_left_alone(scene, method, mesh):
    kept = Kept(content=kept_of(SCENE, METHOD, MESH))
    found = integrate(scene, method, mesh, checkpoints=kept)
    assert kept.rejected == [OF_ANOTHER_RUN]
    assert np.array_equal(found.position, integrate(scene, method, mesh).position)


def test_control_its_own_run_goes_on_from_it():
    kept = Kept(content=kept_of(SCENE, METHOD, MESH))
    # an equal scene and mesh, made anew, as another process would
    scene = spring((0.5, 0.7), T=T, k=2.0, x=1.0, v=0.5)
    found = integrate(scene, METHOD, graded_mesh(T, N, 3.0), checkpoints=kept)
    assert not kept.rejected
    assert np.array_equal(found.position, integrate(SCENE, METHOD, MESH).position)


def test_what_determines_numbers_is_told_apart_and_nothing_else():
    own = fingerprint(SCENE, METHOD, MESH)
    variants = [
        *((SCENE, METHOD, mesh) for mesh in MESHES.values()),
        *((scene, METHOD, MESH) for scene in SCENES.values()),
        (SCENE, METHOD, AdaptiveSteps(tolerance=1e-6)),
        (SCENE, METHOD, AdaptiveSteps(tolerance=1e-6, first_step=1e-3)),
    ]
    assert len({own, *(fingerprint(*one) for one in variants)}) == 1 + len(variants)
    assert fingerprint(SCENE, METHOD, graded_mesh(T, N, 3.0)) == own


def test_a_run_in_parts_refuses_the_checkpoint_of_another():
    part = integrate_part(SCENE, METHOD, N, until=32)
    for scene in SCENES.values():
        with pytest.raises(ValueError, match="of another scene, method or mesh"):
            integrate_part(scene, METHOD, N, checkpoint=part.checkpoint)
    for method, n_steps in (
        (METHOD, N + 1),
        (replace(METHOD, start="graded"), N),
        (replace(METHOD, degree=3, quadrature=None), N),
    ):
        with pytest.raises(ValueError, match="checkpoint: it belongs to a run"):
            integrate_part(SCENE, method, n_steps, checkpoint=part.checkpoint)
    assert integrate_part(SCENE, METHOD, N, checkpoint=part.checkpoint).checkpoint is None


def test_a_checkpoint_that_lacks_something_says_so():
    """With a checksum that holds: another version may have written other things."""
    with np.load(io.BytesIO(kept_of(SCENE, METHOD, MESH))) as found:
        arrays = {name: found[name] for name in found.files if name != "digest"}
    expected, rejected = integrate(SCENE, METHOD, MESH), []
    for missing in arrays:
        left = {name: values for name, values in arrays.items() if name != missing}
        stream = io.BytesIO()
        np.savez(stream, digest=np.array(arrays_digest(left)), **left)
        kept = Kept(content=stream.getvalue())
        if missing in HEAD:
            with pytest.raises(ValueError, match=r"another run|is of another version \("):
                kept.load()
        else:
            found = integrate(SCENE, METHOD, MESH, checkpoints=kept)
            assert np.array_equal(found.position, expected.position)
            rejected += kept.rejected
    # what a state may lack is what not every scene has
    assert set(rejected) == {OF_ANOTHER_RUN}
    assert len(rejected) > 20
