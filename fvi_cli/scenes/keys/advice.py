"""What to write in place of words that people know from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

_DAMPER = "write damping: [{order: 1, coefficient: ...}]"
_ORDER = "order is gamma of the equation of motion, twice the alpha of the fractional action"

KEYS: Final = (
    # of experiments
    ("method", "methods scheme integrator solver", "write method"),
    ("ladder", "steps", "write ladder: {steps: [16, 32, 64]}"),
    ("accuracy", "tolerance tol rtol atol", "write accuracy: {tolerance: 1e-8}"),
    ("designs", "variants cases scenarios members design", "write designs: {bare: {...}}"),
    (
        "problem",
        "kind mass masses stiffness stiffnesses damping dampers rayleigh final_time initial "
        "forcing ground_acceleration exact parameters",
        "it stands under problem; with --set it is problem....",
    ),
    ("steps", "dt h step step_size", "write steps: final_time / h"),
    ("step", "dt every interval", "write step"),
    ("when", "every period strobe", "write {when: sin(2*pi*t/T), direction: rising}"),
    ("bdf", "order", "write bdf for the order of the BDF; Gauss of degree m has order 2 m"),
    # of problems
    ("kind", "type equation model", "write kind"),
    ("final_time", "T tmax t_max t_end tend end_time t_final duration", "write final_time"),
    ("stiffness", "k spring E G", "write stiffness"),
    ("stiffness", "omega0 omega_0 w0 omega_n", "write stiffness, which is mass times omega0**2"),
    ("forcing", "force f load excitation", "write forcing"),
    ("initial", "x0 q0 u0 initial_position", "write initial: {position: ...}"),
    ("initial", "v0 initial_velocity", "write initial: {velocity: ...}"),
    ("position", "x q u displacement", "write position"),
    ("velocity", "v vx dx speed", "write velocity"),
    (
        "damping",
        "zeta xi damping_ratio",
        "write damping: [{order: 1, coefficient: 2*zeta*sqrt(k*m)}]",
    ),
    ("damping", "c delta eta viscosity", _DAMPER),
    # of damping
    ("cubic_stiffness", "alpha", "alpha of Duffing's equation is stiffness"),
    ("cubic_stiffness", "beta", "beta of Duffing's equation is cubic_stiffness"),
    ("order", "alpha beta gamma", f"{_ORDER}; write order"),
    ("damping", "alpha beta gamma", f"{_ORDER}; write it under damping"),
    ("coefficient", "time unrelaxed relaxed", "write law: zener in the same entry"),
    ("coefficient", "modulus", "write law: maxwell in the same entry"),
    ("coefficient", "moduli times", "write law: prony in the same entry"),
)
"""A key that a mapping must have for the advice, words, and the advice."""

VALUES: Final[Mapping[str, str]] = {
    word: advice
    for words, advice in (
        ("dashpot viscous newton", "a springpot of order 1: write {order: 1, coefficient: c}"),
        ("voigt kelvin", "write law: kelvin-voigt"),
        ("yes on", "write true"),
        ("no off", "write false"),
        ("sdof oscillator harmonic-oscillator mass-spring spring", "write damped-oscillator"),
        ("building shear-building storeys", "write frame"),
        ("mdof fem matrices", "write structure"),
        ("custom general own henon-heiles", "write lagrangian, with coordinates and lagrangian"),
        ("sls cole-cole standard-linear-solid", "write law: zener, or law: prony"),
        ("rayleigh", "write rayleigh: {ratios: [0.02, 0.05], modes: [1, 3]} next to damping"),
    )
    for word in words.split()
}
