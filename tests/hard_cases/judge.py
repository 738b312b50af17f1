"""The hard cases of ``hard-cases.yaml``: their claims, what is measured, and the page."""

from __future__ import annotations

import functools
import itertools
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory.damping import law_objection
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import StabilityPrediction, predict_stability
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.members import with_values
from tests.oracles.linear_response import Array, match_scene
from tests.oracles.memory_work import fractional_integral, work_along

FLAGSHIP = "Gauss3"
"""The method for which all claims hold."""
METHODS: Mapping[str, Method] = {
    **{f"Gauss{m}": Method(cq="gauss", degree=m, start="graded") for m in (3, 1, 2, 4)},
    "Lobatto IIIC (degree 3)": Method(cq="lobatto-iiic", degree=3, start="none"),
    **{
        f"BDF{p}": Method(cq=f"bdf{p}", degree=(p + 1) // 2, forcing_quadrature="exact")
        for p in range(1, 7)
    },
    **{f"BDF{p} (nodes)": Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in range(1, 7)},
}
OPTIONS = ("time", "units", "hanging")
"""Keys of a claim that are keywords of its judge."""


class Loader(yaml.SafeLoader):
    """Numbers as in YAML 1.2: 1e4 is one."""


Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.\d*|\.?\d+)([eE][-+]?\d+)?$"),
    list("-+.0123456789"),
)
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?\d+$"), list("-+0123456789")
)


@dataclass(frozen=True)
class Setting:
    """A problem and its exact solution as JSON, and the number of steps."""

    problem: str
    n_steps: int
    truth: str = "null"

    @functools.cached_property
    def scene(self) -> Any:
        """The scene of the problem."""
        return build_scene(json.loads(self.problem))


@dataclass(frozen=True, kw_only=True, eq=False)
class Claim:
    """A limit that one measured number must keep."""

    case: str
    quantity: str
    sense: str
    limit: float
    settings: tuple[Setting, ...]
    judge: str
    options: Mapping[str, Any]

    def measure(self, method: Method) -> tuple[float, str, bool]:
        """The number, the worst status of the runs, and whether one is predicted unstable."""
        of = [predict_stability(one.scene, method, one.n_steps) for one in self.settings]
        results: Sequence[Any] = of
        if self.judge != "called_unstable":
            results = [integrate(one.scene, method, one.n_steps) for one in self.settings]
        status = next((r.status for r in results if getattr(r, "status", "ok") != "ok"), "ok")
        is_unstable = any(one.verdict == "unstable" for one in of)
        if status != "ok":
            return math.nan, status, is_unstable
        measured = JUDGES[self.judge](self.settings, *results, **self.options)
        return float(measured), status, is_unstable

    def holds(self, measured: float) -> bool:
        """Whether a measured number fulfils the claim; nan does not."""
        return measured >= self.limit if self.sense == "at least" else measured <= self.limit


@functools.cache
def cases() -> tuple[dict[str, Any], ...]:
    """Every case with its words, and its :class:`Claim` objects under ``claims``."""
    text = Path(__file__).with_name("hard-cases.yaml").read_text(encoding="utf-8")
    found = yaml.load(text, Loader)
    return tuple({**one, "claims": tuple(claims_of(one["claims"], one, {}))} for one in found)


def claims_of(
    entries: Sequence[Mapping[str, Any]], case: Mapping[str, Any], values: Mapping[str, Any]
) -> Iterator[Claim]:
    for entry in entries:
        for chosen in entry.get("each", [{}]):
            known = {**values, **chosen}
            if "claims" in entry:
                yield from claims_of(entry["claims"], case, known)
                continue
            problem = with_values(
                entry.get("problem", case["problem"]),
                {f"problem.{path}": value for path, value in entry.get("changes", {}).items()},
            )
            runs = entry.get("runs", {})
            settings = [
                Setting(
                    json.dumps(filled(problem, own)),
                    case["steps"],
                    json.dumps(filled(entry.get("truth"), own)),
                )
                for point in itertools.product(*runs.values())
                for own in [{**known, **dict(zip(runs, point, strict=True))}]
            ]
            sense = "at least" if "at least" in entry else "at most"
            yield Claim(
                case=case["name"],
                quantity=entry["quantity"].format(**known),
                sense=sense,
                limit=float(filled(entry[sense], known)),
                settings=tuple(settings),
                judge=entry["judge"],
                options={name: entry[name] for name in OPTIONS if name in entry},
            )


def filled(node: Any, values: Mapping[str, Any]) -> Any:
    """The node with the values of formulas in place of these."""
    if isinstance(node, Mapping):
        return {key: filled(value, values) for key, value in node.items()}
    if isinstance(node, list):
        return [filled(one, values) for one in node]
    if not (isinstance(node, str) and node.startswith("=")):
        return node
    if node[1:] in values:
        return values[node[1:]]
    return float(Expression.parse(node[1:], variables=tuple(values)).evaluate(values))


# --- judges ---------------------------------------------------------------------------------------

Settings = Sequence[Setting]


@functools.lru_cache(maxsize=512)
def exact_positions(setting: Setting, at: tuple[float, ...]) -> Array:
    """By a number or formula, a problem with the same solution, or the scene."""
    truth, time = json.loads(setting.truth), np.array(at)
    if truth is None or isinstance(truth, Mapping):
        return match_scene(build_scene(truth) if truth else setting.scene).position(time)
    values = Expression.parse(truth, variables=("t",)).evaluate({"t": time})
    return np.broadcast_to(np.asarray(values, dtype=float), time.shape)[:, None]


def errors(setting: Setting, run: Any) -> tuple[Array, Array]:
    """Differences from the exact positions, and these."""
    times = run.step_size * np.arange(run.n_steps + 1)
    exact = exact_positions(setting, tuple(times.tolist()))
    return run.position - exact, exact


def largest_ratio(difference: Array, scale: Array) -> float:
    return float(np.abs(difference).max() / np.abs(scale).max())


def error(settings: Settings, *runs: Any) -> float:
    """Largest error over the largest exact position."""
    return max(largest_ratio(*errors(s, r)) for s, r in zip(settings, runs, strict=True))


def error_over_step(settings: Settings, *runs: Any) -> float:
    """Largest error over the distance that a velocity of 1 covers in a step."""
    pairs = zip(settings, runs, strict=True)
    return max(float(np.abs(errors(s, r)[0]).max() / r.step_size) for s, r in pairs)


def error_at(settings: Settings, run: Any, *, time: float) -> float:
    """Relative error at one time."""
    exact = float(exact_positions(settings[0], (float(time),))[0, 0])
    return abs(float(run.position[round(time / run.step_size), 0]) / exact - 1.0)


def difference(settings: Settings, *runs: Any, units: Sequence[float] = ()) -> float:
    """Largest relative difference from the first run, each run in its own unit of length."""
    scales = units or [1.0] * len(runs)
    first, *others = [run.position / unit for run, unit in zip(runs, scales, strict=True)]
    return max(largest_ratio(other - first, first) for other in others)


def error_of_difference(settings: Settings, first: Any, second: Any) -> float:
    """Relative error of the difference of the second run and the first."""
    exact = errors(settings[0], first)[1]
    return largest_ratio(second.position - first.position - exact, exact)


def distance(settings: Settings, first: Any, second: Any) -> float:
    """Largest difference of the positions of two runs."""
    return float(np.abs(first.position - second.position).max())


def energy_gain(settings: Settings, *runs: Any) -> float:
    """The largest energy over the energy at the start, less 1."""
    return max(float(run.energy.max() / run.energy[0] - 1.0) for run in runs)


def energy_change(settings: Settings, run: Any) -> float:
    """The largest change of the energy over the energy at the start."""
    return largest_ratio(run.energy - run.energy[0], run.energy[:1])


def energy_defect(settings: Settings, run: Any, *, hanging: float) -> float:
    r"""Largest :math:`|E(t) + W(t) - E(0)|` over :math:`E(0)` above `hanging`, that at rest."""
    scene, energy = settings[0].scene, run.energy
    velocity = scene.lagrangian.velocity(run.position, run.momentum, run.time)
    force = np.zeros_like(velocity)
    for term in scene.active_damping:
        force += fractional_integral(1.0 - term.order, run.step_size, velocity) @ term.matrix
    work = work_along(force, velocity, run.step_size)
    return float(np.abs(energy + work - energy[0]).max() / (energy[0] - hanging))


def called_unstable(settings: Settings, *predictions: StabilityPrediction) -> float:
    """How many runs are predicted to be unstable."""
    return sum(prediction.verdict == "unstable" for prediction in predictions)


JUDGES: Mapping[str, Callable[..., float]] = {
    one.__name__: one
    for one in (
        *(error, error_over_step, error_at, difference, error_of_difference, distance),
        *(energy_gain, energy_change, energy_defect, called_unstable),
    )
}

# --- the page -------------------------------------------------------------------------------------


def cell(claim: Claim, method: Method) -> str:
    """The number with whether the claim holds, or the status of a run that did not end."""
    if any(law_objection(one.scene, method) for one in claim.settings):
        return "-"
    measured, status, is_unstable = claim.measure(method)
    number = status if status != "ok" else f"{measured:.1e}" if measured else "0"
    return (
        number + ("" if claim.holds(measured) else " NO") + (" (unstable)" if is_unstable else "")
    )


def hard_cases_page() -> str:
    """Every claim of every case with every method."""
    lines = [
        "`NO`: the claim does not hold; `(unstable)`: predicted so; `-`: no method for this law.",
        "",
    ]
    for case in cases():
        lines += [f"## {case['name']}: {case['title']}", ""]
        lines += [f"{case['description']}. Truth: {case['reference']}.", ""]
        rows = [["method", *(f"{c.quantity}: {c.sense} {c.limit:g}" for c in case["claims"])]]
        rows += [["---"] * len(rows[0])]
        rows += [[name, *(cell(c, m) for c in case["claims"])] for name, m in METHODS.items()]
        lines += [*(f"| {' | '.join(row)} |" for row in rows), ""]
    return "\n".join(lines)
