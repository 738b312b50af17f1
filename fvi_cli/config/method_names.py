"""Methods by their names; what a name does not say is as in a configuration."""

from __future__ import annotations

from fvi_cli.config.keys.method_names import keys_of_name
from fvi_cli.config.keys.methods import make_method
from fvi_cli.integrator.method import AnyMethod


def method_named(name: str) -> AnyMethod:
    """The method of a short name, or of the name that it has in files.

    Parameters
    ----------
    name
        ``bdf1`` to ``bdf6``; ``gauss``, ``radau-iia`` or ``lobatto-iiic`` with the degree, as in
        ``gauss3``; or a baseline. What is to be other than by default is joined by ``-``:
        ``nodes`` or ``points``, ``s2`` (the degree), ``gauss2`` or ``lobatto3`` (the rule),
        ``none`` or ``graded``, ``galerkin``, ``exact`` or ``projected``, ``direct``
        or ``exponentials``. ``bdf2-nodes``, ``gauss-s3-graded`` and ``Gauss3`` are such names.

    Raises
    ------
    ValueError
        For a name that says no method.
    """
    try:
        values = keys_of_name(name)
    except ValueError as error:
        raise ValueError(f"method: {error}") from None
    return make_method(values)[0]
