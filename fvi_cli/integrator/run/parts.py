"""Runs in parts, one after the other."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_by_name import as_method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.run.checkpoint import Checkpoint, fingerprint
from fvi_cli.integrator.run.loop import run
from fvi_cli.integrator.run.on_mesh import mesh_for, prepare
from fvi_cli.integrator.run.scenes_run import trajectory_of
from fvi_cli.integrator.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A stretch of a run."""

    # the kept points after the start of the part (with the start for the first one)
    trajectory: Trajectory
    # where the next part begins; None after the end of the run, or a failure
    checkpoint: Checkpoint | None


def integrate_part(
    scene: Scene,
    method: AnyMethod | str,
    n_steps: int,
    *,
    until: int | None = None,
    checkpoint: Checkpoint | None = None,
    every: int = 1,
) -> Part:
    """Integrate from a checkpoint to the next place to stop.

    The joined trajectories of successive parts are that of the whole run to the last bit. Only with
    a Riemann-Liouville derivative of an order above 1 and a start velocity do momenta and energies
    differ: they are those of the steps, which keep the error of the first one. A run that diverges
    may stop a step earlier in parts: its bound uses the largest force so far.

    Arguments as for :func:`fvi_cli.integrator.integrate.integrate`, always those of the whole run;
    the method also by its name, and no baseline. It begins at the checkpoint, which knows the
    method and the number of steps, not the scene; by default at the start. It stops when `until`
    steps of the mesh are done, or up to 16,384 later; by default at the end.

    Raises
    ------
    ValueError
        If the checkpoint belongs to another run, the method is a baseline, or a number is outside
        of its range.
    """
    chosen = as_method(method)
    if not isinstance(chosen, Method):
        raise ValueError(
            f"method: {method_name(chosen)} cannot stop and resume; take a variational method"
        )
    if every < 1:
        raise ValueError(f"every: {every} is not allowed; it must be at least 1")
    began = clock.perf_counter()
    mesh = mesh_for(scene, chosen, n_steps)
    step_size = scene.final_time / n_steps
    run_key = (chosen.case, n_steps, step_size, fingerprint(scene, chosen, mesh))
    if checkpoint is not None and checkpoint.run != run_key:
        case, number, *_ = checkpoint.run
        raise ValueError(
            f"checkpoint: it belongs to a run {case} N={number} of another scene, method or mesh, "
            f"not to {chosen.case} N={n_steps}"
        )
    done = 0 if checkpoint is None else checkpoint.done
    if until is not None and not done < until <= mesh.n_steps:
        raise ValueError(f"until: {until} is not allowed; it must be {done + 1} to {mesh.n_steps}")
    this = prepare([scene], chosen, mesh, every=every)
    if checkpoint is None:
        this.begin()
    else:
        this.go_on(checkpoint.arrays)
        this.recorder.go_on(this.state, checkpoint.done, checkpoint.reported)
    ready = clock.perf_counter()
    run(this.engine, this.source, state=this.state, recorder=this.recorder, until=until)
    trajectory = trajectory_of(
        this,
        0,
        every,
        NO_DIAGNOSTICS,
        with_steps=False,
        seconds=(ready - began, clock.perf_counter() - ready),
    )
    if trajectory.status != "ok" or this.recorder.done == mesh.n_steps:
        return Part(trajectory=trajectory, checkpoint=None)
    return Part(trajectory=trajectory, checkpoint=this.checkpoint(run_key))
