"""What to write in place of words that people know from elsewhere.

A word counts everywhere, ``problem.T`` only under the key ``problem``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final


def _for(words: str, advice: str) -> dict[str, str]:
    return dict.fromkeys(words.split(), advice)


_ORDER = "order is gamma of the equation of motion, twice the alpha of the fractional action"

_DUFFING = "delta, alpha, beta are damping of order 1, stiffness and cubic_stiffness"
KEYS: Final[Mapping[str, str]] = {
    # at the top
    **_for("methods scheme integrator solver", "write method"),
    **_for("steps", "write ladder: {steps: [16, 32, 64]}"),
    **_for("tolerance tol rtol atol", "write accuracy: {tolerance: 1e-8}"),
    **_for("variants cases scenarios members design", "write designs: {bare: {...}}"),
    **_for(
        "kind masses stiffnesses stiffness damping dampers rayleigh final_time initial forcing "
        "ground_acceleration exact parameters",
        "it stands under problem; with --set it is problem....",
    ),
    # of problems
    **_for("type equation model", "write kind"),
    **_for("T tmax t_max t_end tend end_time t_final duration", "write final_time"),
    **_for("k spring", "write stiffness"),
    **_for("force f load excitation", "write forcing"),
    **_for("x0 q0 u0 initial_position", "write initial: {position: ...}"),
    **_for("v0 initial_velocity", "write initial: {velocity: ...}"),
    **_for("omega0 omega_0 w0 omega_n", "write stiffness, which is mass times omega0**2"),
    **_for("zeta xi damping_ratio", "write damping: [{order: 1, coefficient: 2*zeta*sqrt(k*m)}]"),
    **_for("c delta eta viscosity", "write damping: [{order: 1, coefficient: ...}]"),
    **_for("storey", "between floors of a frame it stands under dampers"),
    "<<": "merging is not part of YAML 1.2; repeat the keys",
    # of initial values
    **_for("initial.x initial.q initial.u initial.displacement", "write position"),
    **_for("initial.v initial.vx initial.dx initial.speed", "write velocity"),
    # of damping
    "alpha": f"{_ORDER}; write order",
    "beta": "of damping write order; the factor of x^3 is cubic_stiffness, of kind: duffing",
    "gamma": "the order gamma of the derivative is called order",
    **_for("damping.k damping.E damping.G", "write stiffness, or modulus"),
    **_for("damping.time damping.unrelaxed", "write law: zener in the same entry"),
    **_for("damping.modulus", "write law: maxwell in the same entry"),
    **_for("damping.moduli damping.times", "write law: prony in the same entry"),
    # of methods
    **_for("method.order", "write bdf for the order of the BDF; Gauss of degree m has order 2 m"),
    # of the rest
    **_for("ladder.dt ladder.h ladder.step ladder.step_size", "write steps: final_time / h"),
    **_for("output.dt output.every output.interval", "write step"),
    **_for("events.every period strobe", "write {when: sin(2*pi*t/T), direction: rising}"),
}

VALUES: Final[Mapping[str, str]] = {
    **_for("dashpot viscous newton", "a springpot of order 1: write {order: 1, coefficient: c}"),
    **_for("voigt kelvin", "write law: kelvin-voigt"),
    **_for("yes on", "write true"),
    **_for("no off", "write false"),
    **_for("sdof oscillator harmonic-oscillator mass-spring spring", "write damped-oscillator"),
    **_for("building shear-building storeys", "write frame"),
    **_for("mdof fem matrices", "write structure"),
    **_for("custom general own henon-heiles", "write lagrangian, with coordinates and lagrangian"),
    **_for("sls cole-cole standard-linear-solid", "write law: zener, or law: prony"),
    "rayleigh": "write rayleigh: {ratios: [0.02, 0.05], modes: [1, 3]} next to damping",
}
