"""Which route the steps take: block by block where that pays, otherwise one after the other."""

from __future__ import annotations

from fvi_cli.integrator.block_history import SteppedHistory
from fvi_cli.integrator.block_linear import run_linear_blocks
from fvi_cli.integrator.block_newton import run_newton_blocks
from fvi_cli.integrator.large_linear import run_large_steps
from fvi_cli.integrator.method import History
from fvi_cli.integrator.stepping import Stepped, StepProblem, run_steps

LEAST_BLOCK_STEPS = 16
"""Fewer steps are done sooner one after the other than the matrices of a block are made."""


def run(problem: StepProblem, history: History) -> Stepped:
    """All steps by the route that `history` asks for.

    Parameters
    ----------
    problem
        Everything that the steps need.
    history
        ``direct``: one step after the other, every sum written out; ``fft``: block by block,
        finished blocks convolved into the future by FFT; ``auto``: the quicker one.

    Returns
    -------
    Stepped
        The same to round-off by every route.
    """
    if history == "direct" or (history == "auto" and problem.n_steps < LEAST_BLOCK_STEPS):
        return run_steps(problem)
    if problem.scene.is_linear:
        finished = run_linear_blocks(problem)
        return run_large_steps(problem) if finished is None else finished
    finished = run_newton_blocks(problem)
    if finished is not None:
        return finished
    memory = problem.memory
    if not memory.channels:
        return run_steps(problem)
    return run_steps(problem, SteppedHistory(memory, problem.n_steps, problem.scene.dimension))
