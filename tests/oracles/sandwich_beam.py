r"""Finite elements of a sandwich beam: two elastic faces and a core that shears.

The faces are thin beams with axial displacements :math:`u_1, u_3` of their middle planes and one
deflection w; the core shears by :math:`\gamma = (u_1 - u_3 + d\, w') / h_c`, where d is the
distance of the middle planes (Mead, Markus, *The forced vibration of a three-layer, damped sandwich
beam with arbitrary boundary conditions*, J. Sound Vib. 10, 1969).
"""

import numpy as np
from scipy.sparse import coo_array, csr_array

from fvi_cli.effects.laws import fractional_zener
from fvi_cli.scenes.structures import structure

PER_NODE = 4
"""Degrees of freedom of a node: w, w', u_1, u_3."""


def beam_matrices(
    elements,
    *,
    length,
    width,
    face_thickness,
    core_thickness,
    face_modulus,
    face_density,
    core_density,
):
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


def _shapes(x, size):
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


def _assembled(element, elements):
    """The matrix of equal elements in a row, with the first node clamped."""
    width = 2 * PER_NODE
    first = PER_NODE * np.arange(elements)[:, None, None]
    rows = np.broadcast_to(first + np.arange(width)[:, None], (elements, width, width)).ravel()
    columns = np.broadcast_to(first + np.arange(width), (elements, width, width)).ravel()
    values = np.tile(element.ravel(), elements)
    total = PER_NODE * (elements + 1)
    whole = csr_array(coo_array((values, (rows, columns)), shape=(total, total)))
    return csr_array(whole[PER_NODE:, PER_NODE:])


CORE = {"order": 0.675, "time": 8.23e-9, "relaxed": 3.504e5, "unrelaxed": 3.062e9}
SIZES = {
    "length": 0.1778,
    "width": 0.0127,
    "face_thickness": 1.524e-3,
    "core_thickness": 1.27e-4,
    "face_modulus": 6.9e10,
    "face_density": 2766.0,
    "core_density": 968.0,
}
"""Those of the shipped configuration, whose matrices have 42 elements."""


def sandwich_beam(elements, **data):
    """The scene of a clamped beam whose core follows a fractional Zener law."""
    mass, faces, core = beam_matrices(elements, **SIZES)
    law = fractional_zener(**CORE, coefficient=core)
    return structure(mass=mass, stiffness=faces, laws=[law], **data)
