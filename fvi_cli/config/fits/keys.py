"""Keys of a fit: measurements, parameters and models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from fvi_cli.scenes.keys.mistakes import Wrong, refused
from fvi_cli.scenes.keys.values import BY_FORM, ONE_OR_MANY, Keys, Positive, from_key, key
from fvi_cli.scenes.records.csv_samples import DECIMAL, Decimal


def _of_problem(path: str) -> str:
    words = ""
    if not path.startswith("problem."):
        words = "not a key of the problem, such as problem.stiffness"
    if path in ("problem.kind", "problem.final_time"):
        words = "the same for all; write several experiments"
    if words:
        raise refused(Wrong((), words, of_key=True))
    return path


SweptKey = Annotated[str, AfterValidator(_of_problem), Field(examples=["problem.stiffness"])]


class Parts(Keys):
    """Columns of the parts of an amplitude."""

    magnitude: str | None = key("Column of the magnitude.", None)
    phase: str | None = key("Column of the phase, in degrees.", None)
    real: str | None = key("Column of the real part.", None)
    imaginary: str | None = key("Column of the imaginary part.", None)

    def mistakes(self) -> Iterator[Wrong]:
        """No column."""
        if all(column is None for _, column in self):
            yield Wrong((), "no column; name that of magnitude, phase, real or imaginary")


class Data(Keys):
    """A measured motion, or a steady response."""

    file: str = key("CSV file, from the configuration's folder.")
    time: str | None = key("Column of the times; default: t.", None)
    frequency: str | None = key(
        "Column of frequencies, oscillations per unit of time, in place of time: the data are a "
        "steady response to harmonic forces.",
        None,
    )
    force: Annotated[list[str], Field(min_length=1), ONE_OR_MANY] | None = key(
        "Where the harmonic force of a response acts, as for fvi response.", None
    )
    columns: Annotated[dict[str, Annotated[str | Parts, BY_FORM]], Field(min_length=1)] = key(
        "What was measured, each with its column: coordinates (x, or x1, x2, ...), v and the "
        "name of one for its velocity, a for its acceleration, names under quantities, or "
        "expressions in these. Of a response: coordinates, their combinations, v or a and the "
        "name of one, with the column of the magnitude or {magnitude: ..., phase: ...} "
        "(degrees) or {real: ..., imaginary: ...}."
    )
    decimal: Decimal = DECIMAL
    name: str | None = key("Of the motion; default: the name of the file.", None)
    set: dict[SweptKey, float] = key("Numbers of the problem that differ in this motion.", {})

    def mistakes(self) -> Iterator[Wrong]:
        """Keys of a motion and of a response together."""
        if self.frequency is not None and self.time is not None:
            words = "not together with frequency: the data are a motion or a response"
            yield Wrong(("time",), words, of_key=True)
        if self.frequency is None and self.force is not None:
            words = "only for responses; write frequency: and its column in place of time"
            yield Wrong(("force",), words, of_key=True)
        for name, column in self.columns.items() if self.frequency is None else ():
            if not isinstance(column, str):
                words = "parts are those of a response; name one column"
                yield Wrong(("columns", name), words)


class ParameterKeys(Keys):
    """A number of the problem that is fitted."""

    start: float | None = key("Where the search begins; default: the value in the problem.", None)
    from_: float | None = from_key("Lower bound.", None)
    to: float | None = key("Upper bound.", None)


class ModelKeys(Keys):
    """A description of the problem that is fitted to the same data."""

    set: dict[SweptKey, Any] = key("What is different from the problem of the experiment.", {})
    parameters: dict[SweptKey, ParameterKeys] | None = key(
        "What is fitted; default: those of the fit that are not set.", None
    )


class NoiseKeys(Keys):
    """Noise that grows with what is measured."""

    relative: Positive = key("Standard deviation relative to every measured value.")


class FitKeys(Keys):
    """Parameters, models and measurements of a fit."""

    data: Annotated[list[Data], Field(min_length=1, max_length=100), ONE_OR_MANY] = key(
        "Measured motions, one or several."
    )
    parameters: Annotated[dict[SweptKey, ParameterKeys], Field(min_length=1)] = key(
        "Numbers of the problem that are fitted, by key path: "
        "{problem.damping.0.order: {start: 0.5, from: 0.05, to: 1.95}}."
    )
    noise: Annotated[Literal["auto"] | Positive | NoiseKeys, BY_FORM] = key(
        "Standard deviation of the noise: auto (estimated from the residuals), a number, or "
        "{relative: 0.01}.",
        "auto",
    )
    models: Annotated[dict[str, ModelKeys], Field(min_length=1)] | None = key(
        "Several descriptions that are fitted to the same data and compared; default: the one of "
        "the problem.",
        None,
    )
