"""How far momenta at mesh points keep their order."""

from __future__ import annotations

from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.method import Method

MOST_FOR_MOMENTA = 2**27
"""Most numbers of the steps that are kept to compute the momenta."""


def has_rough_momenta(scene: Scene, method: Method) -> bool:
    """Whether momenta at mesh points keep an error of the first step, h**(2 - order), for good."""
    return method.cq == "gauss" and rate_jumps(scene)


def keeps_for_momenta(scene: Scene, method: Method, n_steps: int) -> bool:
    """Whether all steps are kept because momenta are computed from their velocities."""
    size = n_steps * scene.dimension * (method.degree + 2)
    return has_rough_momenta(scene, method) and size <= MOST_FOR_MOMENTA


def rough_remarks(
    scene: Scene, request: DiagnosticsRequest, *, are_stored_smooth: bool
) -> tuple[str, ...]:
    """Remark on values that have the error of the first step, if the momenta are rough."""
    what = [] if are_stored_smooth else ["momenta and energies"]
    what += ["dissipated work and energies of the balance"] if request.energy_balance else []
    what += ["momentum maps"] if request.symmetries else []
    more = "; positions do not, nor do velocities by quantities, such as vx"
    return (rough_remark(scene, f"{' and '.join(what)} keep", more),) if what else ()


def rough_remark(scene: Scene, what: str, more: str = "") -> str:
    """Remark on the values, `what`, that keep the error of the first step."""
    order = max(term.order for term in scene.active_damping)
    return (
        f"{what} an error like h**{2 - order:.4g} of the first step h (a Riemann-Liouville "
        f"derivative of order {order:g} of a motion with an initial velocity){more}"
    )
