"""All kinds of problems, and the construction of a problem from the mapping in a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final, get_args

from pydantic import ValidationError

from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.scenes.keys.mistakes import first_mistake
from fvi_cli.scenes.keys.values import ByWord, Keys, key, word_of
from fvi_cli.scenes.kinds.fractional_derivative import FractionalDerivative
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.kinds.oscillators import (
    BagleyTorvik,
    DampedOscillator,
    DoublePendulum,
    Duffing,
    Kepler,
    LagrangianKind,
    Pendulum,
)
from fvi_cli.scenes.kinds.rows import Chain, FrameKind, String, Structure
from fvi_cli.scenes.problem import AnyProblem

AnyKind = Annotated[
    DampedOscillator
    | BagleyTorvik
    | Pendulum
    | Duffing
    | Kepler
    | Chain
    | FrameKind
    | Structure
    | String
    | DoublePendulum
    | LagrangianKind
    | Material
    | FractionalDerivative,
    ByWord("kind"),
]
KINDS: Final[Mapping[str, type[Kind]]] = MappingProxyType(
    {word_of(one, "kind"): one for one in get_args(get_args(AnyKind)[0])}
)
"""Every kind by its name, in the order in which they are shown."""


class OnlyProblem(Keys):
    """What members do not share."""

    problem: AnyKind = key("What is solved.")


def read_problem(specification: Mapping[str, Any]) -> Kind:
    """The keys of a ``problem`` mapping of JSON values; absent ones have defaults.

    Raises
    ------
    ArgumentError
        The first mistake, at its key path relative to ``problem``.
    """
    values = dict(specification)
    try:
        return OnlyProblem.model_validate({"problem": values}).problem
    except ValidationError as error:
        found = first_mistake(error)
        found.key = found.key.removeprefix("problem").removeprefix(".")
        raise found from None


def build_problem(specification: Mapping[str, Any]) -> AnyProblem:
    """The problem that a ``problem`` mapping of JSON values describes; absent keys have defaults.

    Raises
    ------
    ValueError
        ``key.path: what is wrong``, relative to ``problem``.
    """
    return read_problem(specification).build_problem()


def build_scene(specification: Mapping[str, Any]) -> Scene:
    """The scene of :func:`build_problem`."""
    scene = build_problem(specification).scene
    if scene is None:
        raise ArgumentError("kind", "a fractional derivative is no scene")
    return scene
