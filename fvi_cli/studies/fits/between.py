"""How much estimates of a fit depend on the displacement between its samples.

Straight lines between samples of a smooth motion have their slopes half an interval late, and a
spline through few samples cuts its peaks. Residuals do not show this, since the parameters adapt.
So the force at the estimates is computed a second time, on a spline of two degrees more, and the
resulting change of the estimates, to first order, is compared with their standard errors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import MotionModel, rms
from fvi_cli.studies.fits.profile import Minimum
from fvi_cli.studies.fits.statistics import covariance

NEGLIGIBLE: Final = 0.3
"""Bias of an estimate, in standard errors, that does not matter: with it intervals of 95 % still
hold the true value in 94 % of the cases."""


class _SmootherModel(MotionModel):
    """The same model with splines of two degrees more between the samples of displacements."""

    def scene(self, number: int, values: Array, index: int = -1, value: float = 0.0) -> Scene:
        found = super().scene(number, values, index, value)
        motion = None if found.prescribed is None else smoother_motion(found.prescribed)
        if motion is None:
            return found
        return replace(found, prescribed=motion, initial_velocity=np.array([motion.start_rate]))


def smoother_motion(motion: PrescribedMotion) -> PrescribedMotion | None:
    """A displacement through the same samples, of two degrees more; None: it is no single spline.

    Splines are those of SciPy's ``make_interp_spline``, with not-a-knot ends.
    """
    pieces = motion.displacement.pieces
    component = pieces[0].components[0]
    if len(pieces) > 1 or not isinstance(component, SampledForce) or component.formula is not None:
        return None
    # only fits of dampers with given displacements need this slow import
    from scipy.interpolate import PPoly, make_interp_spline

    values = motion.displacement(component.knots)[:, 0]
    found = PPoly.from_spline(
        make_interp_spline(component.knots, values, k=component.order + 1).tck
    )
    kept = np.diff(found.x) > 0
    spline = SampledForce(
        knots=np.append(found.x[:-1][kept], found.x[-1]),
        coefficients=found.c[:, kept],
        source=component.source,
    )
    return replace(motion, displacement=Forcing(pieces=(ForcingPiece(components=(spline,)),)))


def between_samples(best: Minimum, variance: float) -> tuple[str, ...]:
    """A warning where a smoother displacement would change the best estimates too much."""
    model, at = best.model, best.evaluation
    scene = model.scene(0, model.values(best.point))
    if scene.prescribed is None or smoother_motion(scene.prescribed) is None or at.jacobian is None:
        return ()
    other = _SmootherModel(model.model, model.data, model.deviations)
    other.meshes = model.meshes
    change = at.residuals - other.evaluate(best.point, with_jacobian=False).residuals
    _, errors, _ = covariance(at, variance)
    moved = np.abs(np.linalg.lstsq(at.jacobian, change, rcond=None)[0]) / errors
    # parameters without errors are left out
    moved = np.nan_to_num(moved, nan=0.0)
    worst = int(np.argmax(moved))
    if not moved[worst] > NEGLIGIBLE:
        return ()
    share = rms(change) / np.sqrt(variance)
    if scene.prescribed.kinks:
        spline = "with interpolation: cubic"
        advice = (
            "if the displacement is smooth write interpolation: cubic under displacement, or "
            "measure with more samples"
        )
    else:
        spline, advice = "with a spline of degree 5", "measure with more samples"
    return (
        f"between the samples: {spline} the force differs by {share:.2g} standard deviations of "
        f"the noise, and {model.free[worst].key} by some {moved[worst]:.2g} standard errors, which "
        f"the intervals do not include; {advice}",
    )
