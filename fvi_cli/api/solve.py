"""Scenes solved to a tolerance."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.studies.tolerance.search import solve as search


def solve(
    scene: Scene, *, tolerance: float | None = None, relative: float | None = None
) -> Trajectory:
    """Integrate a scene such that its position errs by no more than a tolerance, at any time.

    Steps are found on the way and a second run tells the error of the whole
    (``docs/tolerances.md``).

    Parameters
    ----------
    scene
        Effects and initial data.
    tolerance
        Largest error of any component of the position, a length.
    relative
        The same as a share of the largest position of the run; give one of the two.

    Returns
    -------
    Trajectory
        ``trajectory(t)`` and ``trajectory.velocity(t)`` give the motion at any times,
        ``trajectory.error_estimate`` its error, ``trajectory.outcome`` whether the tolerance is
        ``met``; otherwise ``unreliable`` or ``refused``, for the reason in
        ``trajectory.assessment``, with the best run there is.

    Raises
    ------
    ValueError
        If not exactly one of the two is given, or it is not a positive number.
    """
    return search(scene, tolerance=tolerance, relative=relative)
