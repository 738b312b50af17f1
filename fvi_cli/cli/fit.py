"""``fvi fit``: numbers of a problem from measurements."""

from __future__ import annotations

from fvi_cli.cli.exits import CHECK_FAILED, DONE, RUN_FAILED, guarded, verdict
from fvi_cli.cli.options import RESULTS, Check, Configs, Json, Output, Overrides, Quiet, Verbose


@guarded
def fit(
    configs: Configs,
    output: Output = RESULTS,
    check: Check = False,
    as_json: Json = False,
    overrides: Overrides = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Fit numbers of a problem to measured motions, with intervals.

    Writes tables, figures and a configuration with the numbers found. Exit code 1 when a fit does
    not converge; then the best point is told, and why.
    """
    from fvi_cli.render.json import fits_as_json
    from fvi_cli.render.results import compare, show, write
    from fvi_cli.runner.fits.fit import fit_request, write_fitted
    from fvi_cli.runner.request import gather

    found, files, differences = [], [], []
    for request in gather(configs, overrides or ()):
        results = fit_request(request, show_progress=not quiet)
        found += results
        if check:
            differences += compare(results, output, name=request.name)
            continue
        paths = write(results, output, name=request.name)
        paths += write_fitted(request, results, output)
        files += paths
        if not as_json:
            show(results, name=request.name)
            print(*paths, "", sep="\n")
    if as_json:
        print(fits_as_json(found, files, differences if check else None))
    if not all(one.is_converged for one in found):
        return RUN_FAILED
    if as_json:
        return CHECK_FAILED if differences else DONE
    return verdict(differences) if check else DONE
