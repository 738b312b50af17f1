"""Nearly polynomial motions: small coefficients on the way hide nothing of what is left."""

import numpy as np
from spread import spread

from fvi_cli.config import find_config, load_config
from fvi_cli.studies.tolerance.search import solve


@spread(tolerance=[1e-3, 1e-5, 1e-7], name=["bagley-torvik-1-2", "bagley-torvik-3-2"])
def test_the_estimate_is_not_below_the_error_between_points(name, tolerance):
    (problem,) = (
        one.problem
        for one in load_config(find_config("cost-paper")).experiments
        if name in one.name
    )
    assert problem.exact is not None
    run = solve(problem.scene, tolerance=tolerance)
    assert run.assessment.outcome == "met"
    times = np.linspace(0.0, problem.final_time, 2001)
    error = float(np.abs(run(times) - problem.exact(times)).max())
    assert error <= run.assessment.estimate <= tolerance
    # and not far above
    assert run.assessment.estimate <= 30 * error
