"""Why runs stop before their end."""

from __future__ import annotations

from fvi_cli.integrator.engine.state import State, Steps


def not_finite(step: int, time: float) -> str:
    """A step that ends at `time` with numbers that are not finite."""
    return f"not finite after step {step}, t = {time:.6g}"


def no_unique_solution(step_size: float) -> str:
    """A step with singular equations, as with negative stiffness."""
    return (
        f"the equations of a step of length {step_size:.6g} have no unique solution; take "
        "another number of steps"
    )


def why_unsolved(steps: Steps, state: State, member: int = 0) -> str:
    """Why a step of a member that begins at `state` has no solution."""
    if steps.finite is None:
        return no_unique_solution(steps.h)
    near = "[" + ", ".join(f"{value:.4g}" for value in state.x[member]) + "]"
    if steps.finite[member]:
        return f"Newton's iteration did not converge near q = {near}; take a smaller step"
    return (
        "the force is not finite (no real number, or a division by zero) near "
        f"q = {near}; take a smaller step if the motion itself stays away from there"
    )
