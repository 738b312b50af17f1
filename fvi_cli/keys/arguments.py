"""Arguments of functions and classes: errors of wrong calls list the names of arguments."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, ParamSpec, TypeVar

from fvi_cli.keys.complaints import listed, suggestion

P = ParamSpec("P")
T = TypeVar("T")
_OTHER_NAMES: Final = {
    "initial": "initial_position and initial_velocity",
    **dict.fromkeys(("x0", "q0", "u0"), "initial_position"),
    "v0": "initial_velocity",
    **dict.fromkeys(("T", "t_end", "tend", "tmax", "t_max", "duration"), "final_time"),
    "force": "forcing",
    **dict.fromkeys(("steps", "n", "N", "number"), "n_steps"),
    **dict.fromkeys(("tol", "rtol", "atol"), "tolerance"),
    **dict.fromkeys(("mu", "c"), "coefficient"),
    **dict.fromkeys(("set", "changes"), "overrides"),
}


def check_arguments(
    name: str, unnamed: Sequence[Any], given: Mapping[str, Any], signature: inspect.Signature
) -> None:
    """Refuse arguments that a function does not have, and calls without those that it needs.

    Raises
    ------
    TypeError
        With the names that are allowed.
    """
    known = signature.parameters
    by_place = [one for one in known.values() if one.kind is not one.KEYWORD_ONLY]
    if any(one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD) for one in known.values()):
        return
    if len(unnamed) > len(by_place):
        needed = [one for one in known.values() if one.default is one.empty]
        shown = [one.name if one in by_place else f"{one.name}=..." for one in needed]
        most = f"at most {len(by_place)}" if by_place else "none"
        raise TypeError(
            f"{name}: {most} of the arguments may stand without its name; write "
            f"{name}({', '.join(shown)}) (arguments: {listed(known)})"
        )
    taken = [one.name for one in by_place[: len(unnamed)]]
    for one in given:
        if one not in known:
            other = _OTHER_NAMES.get(one, "")
            is_own = other and other.partition(" ")[0] in known
            hint = f"; write {other}" if is_own else suggestion(one, known)
            raise TypeError(f"{name}: {one!r} is no argument{hint} (arguments: {listed(known)})")
        if one in taken:
            raise TypeError(f"{name}: {one} is given twice, without and with its name")
    for one, parameter in known.items():
        if parameter.default is parameter.empty and one not in (*given, *taken):
            raise TypeError(f"{name}: {one} is missing; write {name}({one}=..., ...)")


def explained(function: Callable[P, T], name: str = "") -> Callable[P, T]:
    """The function, whose wrong calls raise a TypeError with the names of its arguments."""
    name = name or function.__name__
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*unnamed: P.args, **given: P.kwargs) -> T:
        try:
            return function(*unnamed, **given)
        except TypeError as error:
            check_arguments(name, unnamed, given, signature)
            raise error from None

    return checked


def explained_class(made: type[T]) -> type[T]:
    """The class, whose wrong calls raise a TypeError with the names of its arguments."""
    begin, signature = made.__init__, inspect.signature(made)

    @functools.wraps(begin)
    def checked(self: Any, *unnamed: Any, **given: Any) -> None:
        try:
            begin(self, *unnamed, **given)
        except TypeError:
            check_arguments(made.__name__, unnamed, given, signature)
            raise

    made.__init__ = checked  # type: ignore[method-assign]
    return made
