r"""Finite elements of a sandwich beam: two elastic faces and a core that shears.

The faces are thin beams with axial displacements :math:`u_1, u_3` of their middle planes and one
deflection w; the core shears by :math:`\gamma = (u_1 - u_3 + d\, w') / h_c`, where d is the
distance of the middle planes (Mead, Markus, *The forced vibration of a three-layer, damped sandwich
beam with arbitrary boundary conditions*, J. Sound Vib. 10, 1969).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Unpack, cast

import numpy as np

from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Form, SparseMatrix
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.data import SceneData, make_scene

PER_NODE = 4
"""Degrees of freedom of a node: w, w', u_1, u_3."""


def beam_matrices(
    elements: int,
    *,
    length: float,
    width: float,
    face_thickness: float,
    core_thickness: float,
    face_modulus: float,
    face_density: float,
    core_density: float,
) -> tuple[Form, Form, Form]:
    """M, K of faces, K of a core with shear modulus 1, each ``(4 elements, 4 elements)``.

    Each node except the clamped one has four degrees of freedom: w, w', u_1, u_3. In every element
    the deflection is cubic and axial displacements are linear.
    """
    size = length / elements
    hf, hc, b = face_thickness, core_thickness, width
    area, inertia = b * hf, b * hf**3 / 12.0
    line_mass = 2.0 * face_density * area + core_density * b * hc
    nodes, weights = np.polynomial.legendre.leggauss(4)
    mass, faces, core = (np.zeros((2 * PER_NODE, 2 * PER_NODE)) for _ in range(3))
    for node, weight in zip(nodes, weights, strict=True):
        w, slope, bend, u1, u3, stretch1, stretch3 = _shapes(0.5 * (1.0 + node), size)
        part = 0.5 * size * weight
        shear = (u1 - u3 + (hf + hc) * slope) / hc
        mass += part * line_mass * np.outer(w, w)
        axial = face_density * area + core_density * b * hc / 6.0
        mass += part * axial * (np.outer(u1, u1) + np.outer(u3, u3))
        faces += part * face_modulus * 2.0 * inertia * np.outer(bend, bend)
        faces += part * face_modulus * area * np.outer(stretch1, stretch1)
        faces += part * face_modulus * area * np.outer(stretch3, stretch3)
        core += part * b * hc * np.outer(shear, shear)
    return _assembled(mass, elements), _assembled(faces, elements), _assembled(core, elements)


def _shapes(x: float, size: float) -> tuple[Array, ...]:
    """Shape functions: deflection, slope, curvature, axial displacements, stretches at x."""
    zero = np.zeros(2 * PER_NODE)
    w, slope, bend, u1, u3, stretch1, stretch3 = (zero.copy() for _ in range(7))
    bending = [0, 1, PER_NODE, PER_NODE + 1]
    w[bending] = [
        1 - 3 * x**2 + 2 * x**3,
        size * (x - 2 * x**2 + x**3),
        3 * x**2 - 2 * x**3,
        size * (x**3 - x**2),
    ]
    slope[bending] = [
        (6 * x**2 - 6 * x) / size,
        1 - 4 * x + 3 * x**2,
        (6 * x - 6 * x**2) / size,
        3 * x**2 - 2 * x,
    ]
    bend[bending] = [
        (12 * x - 6) / size**2,
        (6 * x - 4) / size,
        (6 - 12 * x) / size**2,
        (6 * x - 2) / size,
    ]
    for values, stretch, place in ((u1, stretch1, 2), (u3, stretch3, 3)):
        values[[place, PER_NODE + place]] = [1 - x, x]
        stretch[[place, PER_NODE + place]] = [-1 / size, 1 / size]
    return w, slope, bend, u1, u3, stretch1, stretch3


def _assembled(element: Array, elements: int) -> Form:
    """The matrix of equal elements in a row, with the first node clamped."""
    from scipy.sparse import coo_array, csr_array

    width = 2 * PER_NODE
    first = PER_NODE * np.arange(elements)[:, None, None]
    rows = np.broadcast_to(first + np.arange(width)[:, None], (elements, width, width)).ravel()
    columns = np.broadcast_to(first + np.arange(width), (elements, width, width)).ravel()
    values = np.tile(element.ravel(), elements)
    total = PER_NODE * (elements + 1)
    whole = csr_array(coo_array((values, (rows, columns)), shape=(total, total)))
    return cast(SparseMatrix, csr_array(whole[PER_NODE:, PER_NODE:]))


def beam_coordinates(elements: int) -> tuple[str, ...]:
    """Names of the degrees of freedom: w1, r1, a1, b1, w2, ..."""
    return tuple(f"{kind}{node}" for node in range(1, elements + 1) for kind in "wrab")


def beam_scene(mass: Form, faces: Form, core: Law, **data: Unpack[SceneData]) -> Scene:
    """Scene of a beam by its matrices and the law of its core."""
    scene = make_scene(mass, QuadraticPotential(stiffness=faces), **data)
    return replace(scene, laws=(*scene.laws, core))
