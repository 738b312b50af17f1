"""``material``: a damper on the bench: the displacement is given, the force is computed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.scenes.forces import TimeFunction, build_forcing
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import BY_FORM, Positive, key
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.kinds.laws import Term, check_names_of_dampers, effects_of
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.samples import Samples

COORDINATE: Final = "u"


class Material(Kind):
    """A law whose displacement is given."""

    equation = "force = sum of g(D) u, u(t) given"
    forces = ("displacement",)
    solutions = ()
    kind: Literal["material"] = key("Which equation.", "material")
    law: Annotated[Term | Annotated[list[Term], Field(min_length=1)], BY_FORM] = key(
        "A law or springpot as under damping of other kinds, or a list of parallel ones; its "
        "coefficient multiplies the displacement."
    )
    displacement: TimeFunction = key(
        "u(t): number or expression in t, {pieces: [...]} without jumps, or samples, {file: "
        "bench.csv, column: u, time: t}, equally spaced or not. A strain "
        "where the force is a stress.",
        unit="length",
    )
    final_time: Positive | None = key(
        "End T of the interval [0, T]; of samples it is the last one.", None, unit="time"
    )

    def mistakes(self) -> Iterator[Wrong]:
        """No end, too."""
        yield from super().mistakes()
        if self.final_time is None and not isinstance(self.displacement, Samples):
            yield Wrong(("final_time",), "missing; it must be a positive number")

    @model_validator(mode="after")
    def _fill_time(self) -> Self:
        if self.final_time is None and isinstance(self.displacement, Samples):
            self.__dict__["final_time"] = float(self.displacement.value[-1, 0])
            self.__pydantic_fields_set__.add("final_time")
        return self

    def build_motion(self) -> PrescribedMotion:
        """The displacement."""
        final_time = float(self.final_time or 0.0)
        displacement = build_forcing(
            self.displacement, (COORDINATE,), "displacement", final_time, self.parameters
        ) or Forcing.from_text("0")
        motion = PrescribedMotion(displacement=displacement, final_time=final_time)
        motion.check()
        return motion

    def build_problem(self, motion: PrescribedMotion | None = None) -> Problem:
        """The law along its displacement, or along `motion`; it has no errors."""
        motion = motion or self.build_motion()
        terms = self.law if isinstance(self.law, list) else [self.law]
        effects = effects_of(terms, (COORDINATE,), "law")
        check_names_of_dampers(effects, "law")
        for one in effects:
            is_rough = isinstance(one, FractionalDamping) and one.order > 1
            if is_rough and (motion.kinks or motion.displacement.break_points):
                raise ArgumentError(
                    f"law.{one.number - 1}.order",
                    "orders above 1 are not allowed with straight lines between samples: its force "
                    "is infinite at every kink; write interpolation: cubic",
                )
        scene = Scene(
            inertia=Inertia(mass=1.0),
            initial_position=np.array([motion.start]),
            initial_velocity=np.array([motion.start_rate]),
            final_time=motion.final_time,
            damping=cast(Any, effects),
            prescribed=motion,
        )
        problem = Problem(
            kind=self.kind,
            scene=scene,
            exact_source="none",
            equation=self.equation,
            coordinates=(COORDINATE,),
        )
        return problem.with_parameters(self.parameters)
