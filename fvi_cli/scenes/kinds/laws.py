"""Damping terms: keys of fractional derivatives and relaxation laws, and their effects."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar, Final, Literal, cast

import numpy as np
from pydantic import Field

from fvi_cli.effects.damping import Coefficient, FractionalDamping
from fvi_cli.effects.directions import read_directions
from fvi_cli.effects.laws import ColeCole, Law, fractional_maxwell, fractional_zener, prony
from fvi_cli.effects.matrices import Factored, dense, is_sparse
from fvi_cli.errors import ArgumentError, listed
from fvi_cli.scenes.data import Effect
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    ByWord,
    Count,
    Fraction,
    Keys,
    Name,
    NotNegative,
    Order,
    Positive,
    key,
)
from fvi_cli.scenes.records.matrices import MatrixFile, NumberOrMatrix

_MODULUS: Final = "stiffness over that of coefficient"
_FACTOR: Final = "mass times time^(gamma-2)"
_NAME: Final = (
    "What quantities know the damper by: force_top, deformation_top and work_top for name: top; "
    "without it by its number, force_1: those under damping, then those under dampers. Where it "
    "acts in several storeys, or on several combinations, their number stands behind: force_top_3."
)


_NO_NUMBERS: Final = ("acts_on", "storey", "name", "law", "coefficient", "matrix")


class Damper(Keys):
    """What every damper has: where it acts, and its name."""

    make: ClassVar[Callable[..., Effect]]
    """The function that makes the effect of own keys and a coefficient."""

    acts_on: Annotated[list[str], Field(min_length=1)] | None = key(
        "Coordinates or linear combinations of them on which the term acts, one per row of the "
        "coefficient; without it: every coordinate.",
        None,
    )
    storey: Annotated[Count | list[Count], BY_FORM] | None = key(
        "Under dampers of a frame or chain, storey (spring) i in which it stands: in a frame it "
        "acts on x_i - x_(i-1), in storey 1 on x_1; or a list for equal dampers in several; "
        "without it one stands in every storey.",
        None,
    )
    name: Name | None = key(_NAME, None)

    @property
    def factor(self) -> Any:
        """The factor of the term: a number, matrix or file."""
        given = (vars(self).get(name) for name in ("coefficient", "matrix"))
        return next((one for one in given if one is not None), 1.0)

    def effects(self, on: Callable[[Any], Any]) -> tuple[Effect, ...]:
        """The effects; `on` converts a factor to the coefficient for all coordinates."""
        own = {name: one for name, one in self if name not in _NO_NUMBERS}
        return (type(self).make(**own, coefficient=on(self.factor)),)


class Springpot(Damper):
    """A term mu D^gamma q."""

    make = FractionalDamping
    law: Literal["springpot"] = key("Which law; the default.", "springpot", exclude=True)
    order: Order = key("Order gamma of the derivative.", 1.0)
    coefficient: NumberOrMatrix = key(
        "Factor mu, a number, a symmetric matrix or {file: C.mtx}.", unit=_FACTOR
    )


class KelvinVoigt(Damper):
    """A spring parallel to a springpot."""

    law: Literal["kelvin-voigt"] = key("Which law.", "kelvin-voigt")
    stiffness: NumberOrMatrix = key(
        "Stiffness of the spring, a number or a symmetric matrix.", unit="mass per time^2"
    )
    coefficient: NumberOrMatrix = key(
        "Factor mu of the springpot parallel to it, a number or a symmetric matrix.", unit=_FACTOR
    )
    order: Order = key("Order gamma of the springpot; 1 is a dashpot.", 1.0)

    def effects(self, on: Callable[[Any], Any]) -> tuple[Effect, ...]:
        """The springpot, and the spring as a law without memory."""
        springpot = FractionalDamping(order=self.order, coefficient=on(self.factor))
        forgetful = ColeCole(order=0.5, time=1.0)
        spring = Law(kernel=forgetful, size=0.0, relaxed=1.0, coefficient=on(self.stiffness))
        return springpot, spring


class _Relaxing(Damper):
    """A relaxation law with its factor."""

    coefficient: NumberOrMatrix | None = key(
        "Factor of the law (without it 1), a number, a symmetric matrix or {file: Kv.mtx}.", None
    )
    matrix: NumberOrMatrix | None = key("The same under another name, for matrices.", None)

    def mistakes(self) -> Iterator[Wrong]:
        """Two factors."""
        if self.matrix is not None and self.coefficient is not None:
            yield Wrong(("matrix",), "give this or coefficient, not both", of_key=True)


class Zener(_Relaxing):
    """The fractional Zener law."""

    make = staticmethod(fractional_zener)
    law: Literal["zener"] = key("Which law.", "zener")
    order: Fraction = key("Order a of the law, in (0, 1).")
    time: Positive = key("Relaxation time tau.", unit="time")
    relaxed: NotNegative = key("Modulus G0 of slow motions.", unit=_MODULUS)
    unrelaxed: NotNegative = key("Modulus of fast motions, at least the relaxed.", unit=_MODULUS)


class Maxwell(_Relaxing):
    """The fractional Maxwell law."""

    make = staticmethod(fractional_maxwell)
    law: Literal["maxwell"] = key("Which law.", "maxwell")
    order: Fraction = key("Order a of the law, in (0, 1).")
    time: Positive = key("Relaxation time tau.", unit="time")
    modulus: Positive = key("Modulus G of fast motions.", unit=_MODULUS)


class Prony(_Relaxing):
    """A sum of exponentials."""

    make = staticmethod(prony)
    law: Literal["prony"] = key("Which law.", "prony")
    moduli: list[Positive] = key(
        "Moduli g_i of the springs and dashpots.", unit=_MODULUS, min_length=1, max_length=1000
    )
    times: list[Positive] = key(
        "Their relaxation times tau_i.", unit="time", min_length=1, max_length=1000
    )
    relaxed: NotNegative = key("Modulus that remains after a long time.", 0.0, unit=_MODULUS)


AnyTerm = Springpot | KelvinVoigt | Zener | Maxwell | Prony
Term = Annotated[AnyTerm, ByWord("law", usual="springpot")]


def effects_of(
    terms: Sequence[AnyTerm], names: Sequence[str], place: str = "damping", *, before: int = 0
) -> tuple[Effect, ...]:
    """Effects of the terms in the list at `place`; dampers are numbered from `before` + 1 on.

    Coefficients that are numbers stay numbers: scenes know where they act.
    """
    found: list[Effect] = []
    for index, term in enumerate(terms):
        try:
            made = term.effects(partial(_coefficient, term, names))
        except ArgumentError as error:
            raise error.below(f"{place}.{index}") from None
        storeys = [term.storey] if isinstance(term.storey, int) else term.storey or ()
        for one in made:
            # `replace` would check its matrix again
            own = copy.copy(one)
            vars(own).update(name=term.name or "", number=before + index + 1, storeys=(*storeys,))
            found.append(own)
    return tuple(found)


def _coefficient(term: AnyTerm, names: Sequence[str], factor: Any) -> Coefficient:
    """A factor of a term, along the combinations of coordinates on which the term acts."""
    given = factor.value if isinstance(factor, MatrixFile) else factor
    if term.acts_on is None:
        return cast(Coefficient, given)
    if term.storey is not None:
        raise ArgumentError("storey", "give this or acts_on, not both", at_key=True)
    rows = read_directions(term.acts_on, names)
    return Factored(rows=rows, inner=dense(given) if is_sparse(given) else np.asarray(given))


def check_names_of_dampers(every: Sequence[Effect], place: str) -> None:
    """Refuse two dampers with the same name."""
    names = [name for _, name in {(one.number, one.name) for one in every} if name]
    if len({*names}) < len(names):
        raise ArgumentError(place, f"two dampers have one name among {listed(sorted(names))}")
