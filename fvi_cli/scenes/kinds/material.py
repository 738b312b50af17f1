"""``material``: a damper on the bench: the displacement is given, the force is computed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import OneOrMany
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.settings import Positive, key
from fvi_cli.scenes.forces import (
    PARAMETERS,
    GroundMotion,
    Parameters,
    build_forcing,
    with_parameters,
)
from fvi_cli.scenes.kinds import shared_keys as shared
from fvi_cli.scenes.kinds.damping_keys import (
    Term,
    build_damping,
    check_names_of_dampers,
    damping_terms,
)
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.lagrangian import check_names, names_of_dampers
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.inputs import numbers_of

FEWEST_SAMPLES: Final = 8
COORDINATE: Final = "u"


class Material(
    Kind,
    declares="parameters",
    refused={
        **shared.WRONG_AT_PROBLEM,
        "damping": "not a key here: write law: {law: zener, ...}, or a list of parallel laws",
        "strain": "not a key: write displacement, in any unit",
        "mass": "not a key here: a damper on the bench has none; with a mass it is kind: "
        "damped-oscillator",
    },
):
    """A law whose displacement is given."""

    kind = "material"
    title = "damper on the bench"
    equation = "force = sum of g(D) u, u(t) given"
    example: ClassVar = {
        "law": "{law: zener, order: 0.5, time: 0.2, relaxed: 1.0, unrelaxed: 4.0}",
        "displacement": "0.01*sin(6*t)",
        "final_time": "5.0",
    }
    sweep = "problem.law.order: {from: 0.2, to: 0.8, number: 4}"
    methods = "{rk: gauss, degree: 4}"
    forces = ("displacement",)

    law: Annotated[tuple[Term, ...], OneOrMany(shape=damping_terms().shape, as_it_stands=True)] = (
        key(
            "A law or springpot as under damping of other kinds, or a list of parallel ones; "
            "its coefficient multiplies the displacement."
        )
    )
    displacement: GroundMotion = key(
        "u(t): number or expression in t, {pieces: [...]} without jumps, or samples, {file: "
        "bench.csv, column: u, time: t}, equally spaced or not. A strain "
        "where the force is a stress.",
        unit="length",
    )
    final_time: Positive = key(
        "End T of the interval [0, T]; of samples it is the last one.", unit="time", default=None
    )
    parameters: Parameters = PARAMETERS

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys, with the time of the last sample as default of ``final_time``."""
        given = values.get("displacement")
        if isinstance(given, Mapping) and "digest" in given:
            time = numbers_of(given)[:, 0]
            if time.size < FEWEST_SAMPLES:
                at.refuse(
                    f"{time.size} samples of a displacement; at least {FEWEST_SAMPLES} are needed",
                    "displacement",
                )
            values.setdefault("final_time", float(time[-1]))
        return values

    def build_scene(self) -> Scene:
        """The law along its displacement."""
        if self.final_time is None:
            raise ArgumentError("final_time", "missing; it must be a positive number")
        final_time = float(self.final_time)
        damping, laws = build_damping(self.law, (COORDINATE,), place="law")
        check_names_of_dampers((*damping, *laws), "law")
        given = with_parameters(vars(self))["displacement"]
        displacement = build_forcing(given, 1, "displacement", final_time=final_time)
        if displacement is None:
            raise ArgumentError("displacement", "it is constant; give a displacement that changes")
        motion = PrescribedMotion(displacement=displacement, final_time=final_time)
        motion.check()
        for one in damping:
            if one.order > 1 and (motion.kinks or displacement.break_points):
                raise ArgumentError(
                    f"law.{one.number - 1}.order",
                    f"{one.order:g} is not allowed with straight lines between samples: its force "
                    "is infinite at every kink; write interpolation: cubic",
                )
        scene = Scene(
            inertia=Inertia(mass=1.0),
            initial_position=np.array([motion.start]),
            initial_velocity=np.array([motion.start_rate]),
            final_time=final_time,
            damping=damping,
            laws=laws,
            prescribed=motion,
        )
        if self.parameters:
            check_names((COORDINATE,), self.parameters, names_of_dampers(scene))
        return scene

    def build_problem(self, *, search: bool = True) -> Problem:
        """The law along its displacement, which has no errors."""
        return Problem(
            kind=self.kind,
            scene=self.build_scene(),
            exact_source="none",
            equation=self.equation,
            coordinates=(COORDINATE,),
            numbers=self.parameters or {},
        )
