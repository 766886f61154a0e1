"""Parameters of a scene: numbers of the scene with a name and a range. Their ranges span a box,
over which a reduced model is trained, run and tested. Training runs are made at points of the box:
a Latin hypercube, the corners, or chosen by estimated errors."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from numbers import Real
from typing import Annotated, Any, Literal, TypeGuard

import numpy as np
from pydantic import BaseModel, Field, model_validator

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.scene.overrides import find, split

Point = Mapping[str, float]
"""Parameter -> value."""
_NO_MODEL = ("format", "seed", "time", "output", "parameters", "training", "reducer")
"""Keys with numbers that are not of the model: training runs over a box have the same steps."""
CENTRE = 0.5
"""Centre of a range, as a share of its width."""
SAMPLES = 9
"""Number of training runs unless the scene gives one."""


class Parameter(Plugin):
    """Number of the scene, at one key or at several that have the same value, and its range."""

    key: str | Annotated[list[str], Field(min_length=1)]
    """Dotted key of the scene, as for `--set`, or several."""
    range: Annotated[list[float], Field(min_length=2, max_length=2)]
    """Smallest and largest value."""

    @model_validator(mode="after")
    def _ordered(self) -> "Parameter":
        if not self.range[0] < self.range[1]:
            raise InputError(f"the first value must be the smaller one (got {self.range})", "range")
        return self

    @property
    def keys(self) -> tuple[str, ...]:
        return (self.key,) if isinstance(self.key, str) else tuple(self.key)

    def at(self, share: float) -> float:
        """Value at a share of the range: 0 the smallest, 1 the largest."""
        low, high = self.range
        return low + share * (high - low)


def values_at(point: Point) -> dict[str, float]:
    """Values of parameters as overrides. Raises InputError for anything but names and values."""
    if not isinstance(point, Mapping):
        raise InputError(f"give names with values, such as {{flux: 1e6}} (got {point!r})")
    return {f"parameters.{name}": value for name, value in point.items()}


def with_values(tree: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides in which `parameters.NAME: number` is replaced by the keys of that parameter of the
    scene `tree`. Raises InputError for an unknown parameter."""
    found: dict[str, Any] = {}
    declared = tree.get("parameters")
    named = declared if isinstance(declared, Mapping) else {}
    for key, value in overrides.items():
        path = split(key)
        if len(path) != 2 or path[0] != "parameters" or value is None or isinstance(
                value, Mapping | BaseModel):
            found[key] = value
            continue
        if not _is_number(value):
            raise InputError(f"the value of a parameter is a number (got {value!r})", key)
        entry = named.get(path[1])
        if not isinstance(entry, Mapping) or "key" not in entry:
            raise InputError([Fault(key, "the scene declares no such parameter: "
                                    + suggestions(str(path[1]), list(named), "declared"))])
        keys = entry["key"]
        plain = value if isinstance(value, int) else float(value)
        found |= dict.fromkeys([keys] if isinstance(keys, str) else keys, plain)
    return found


def parameter_faults(
    parameters: Mapping[str, Parameter], scene: BaseModel, tree: Mapping[str, Any]
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Location and message of each fault: keys without a number, keys of one parameter with
    different values. tree: the data of the scene."""
    owners: dict[tuple[str | int, ...], str] = {}
    for name, p in parameters.items():
        values = [number_at(scene, tree, key) for key in p.keys]
        numbers = [v for v in values if v is not None]
        at = ("parameters", name, "key")
        for i, (key, value) in enumerate(zip(p.keys, values, strict=True)):
            if value is None:
                yield at if isinstance(p.key, str) else (*at, i), (
                    f"there is no number of the model at {key or 'no key'} in the scene: give "
                    "the key of one, and write it there")
            elif (owner := owners.setdefault(tuple(find(tree, key)), name)) != name:
                yield at if isinstance(p.key, str) else (*at, i), (
                    f"{key} is a key of parameter {owner} already")
        if numbers == values and len(set(numbers)) > 1:
            yield at, f"its keys have different values: {', '.join(f'{v:g}' for v in numbers)}"


def number_at(scene: BaseModel, tree: Mapping[str, Any], key: str) -> float | None:
    """Number at a dotted key of a scene (of a function of time: its only option), None where there
    is none. tree: the data of the scene."""
    path = find(tree, key)
    if path[0] in _NO_MODEL:
        return None
    value: object = scene
    for part in path:
        if isinstance(value, BaseModel):
            value = dict(value).get(str(part))
        elif isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, Sequence) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    if isinstance(value, TimeFunction) and isinstance(value, BaseModel):
        options = [option for _, option in value]
        value = options[0] if len(options) == 1 else None
    return float(value) if _is_number(value) else None


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, Real) and not isinstance(value, bool)


# ------------------------------------------------------------------ training runs


class BoxTraining(Plugin):
    """Points of the box of parameters with a training run each; the snapshots of all runs together
    define the reduced model."""

    choice: Literal["latin_hypercube", "corners", "greedy"] = "latin_hypercube"
    """`latin_hypercube`: each parameter has one value in each of `samples` equal parts of its
    range, combined at random. `corners`: all combinations of smallest and largest values, and the
    centre. `greedy`: begins with the centre and adds the candidate at which a run of the reduced
    model estimates the largest error."""
    samples: int | None = Field(default=None, ge=1)
    """Number of training runs, 9 by default; with `greedy` the largest number."""
    seed: int = Field(default=0, ge=0)
    """Seed of `latin_hypercube` and of the candidates of `greedy`."""
    candidates: int = Field(default=12, ge=1)
    """Number of candidates of `greedy`, in addition to the corners of the box."""
    tolerance: float = Field(default=1e-3, gt=0)
    """Estimated error, relative to the largest change of a block, at which `greedy` ends."""
    points: list[dict[str, float]] | None = Field(default=None, min_length=1)
    """The points themselves, instead of a choice: all parameters of each."""
    workers: int = Field(default=1, ge=1)
    """Number of processes that make the training runs, with the same digits; `greedy` makes them
    one after the other."""

    @model_validator(mode="after")
    def _used(self) -> "BoxTraining":
        used = {"points", "workers"} if self.points is not None else {
            "latin_hypercube": {"choice", "samples", "seed", "workers"},
            "corners": {"choice", "workers"},
            "greedy": {"choice", "samples", "seed", "candidates", "tolerance"}}[self.choice]
        for name in sorted(self.model_dump(exclude_defaults=True).keys() - used):
            raise InputError("has no effect next to points" if self.points is not None else
                             f"has no effect with choice: {self.choice}", name)
        return self

    def runs(self, parameters: Mapping[str, Parameter]) -> int:
        """Number of training runs, with `greedy` the largest number."""
        if self.points is not None:
            return len(self.points)
        return 2 ** len(parameters) + 1 if self.choice == "corners" else self.samples or SAMPLES

    def chosen(self, parameters: Mapping[str, Parameter]) -> list[Point]:
        """Points of the training runs; with `greedy` the first one."""
        if self.points is not None:
            return list(self.points)
        centre = {n: p.at(CENTRE) for n, p in parameters.items()}
        if self.choice == "latin_hypercube":
            return latin_hypercube(parameters, self.runs(parameters), self.seed)
        return [centre, *corners(parameters)] if self.choice == "corners" else [centre]

    def others(self, parameters: Mapping[str, Parameter]) -> list[Point]:
        """Candidates of `greedy`."""
        return [*corners(parameters), *latin_hypercube(parameters, self.candidates, self.seed)]


def corners(parameters: Mapping[str, Parameter]) -> list[Point]:
    """The 2^p corners of the box."""
    return [dict(zip(parameters, values, strict=True))
            for values in product(*(p.range for p in parameters.values()))]


def latin_hypercube(parameters: Mapping[str, Parameter], count: int, seed: int) -> list[Point]:
    """Latin hypercube sample of the box: each of `count` equal parts of a range is used once."""
    rng = np.random.default_rng(seed)
    shares = [(rng.permutation(count) + rng.random(count)) / count for _ in parameters]
    return _at(parameters, np.array(shares).T)


def uniform(parameters: Mapping[str, Parameter], count: int, seed: int) -> list[Point]:
    """Independent points, uniformly distributed over the box."""
    return _at(parameters, np.random.default_rng(seed).random((count, len(parameters))))


def _at(parameters: Mapping[str, Parameter], shares: FloatArray) -> list[Point]:
    return [{n: p.at(float(s)) for (n, p), s in zip(parameters.items(), row, strict=True)}
            for row in shares]


def training_faults(
    parameters: Mapping[str, Parameter], training: BoxTraining
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Location and message of each fault of the points: without parameters, or of others."""
    if not parameters:
        yield ("training", "parameters"), "the scene declares no parameters"
    for i, point in enumerate(training.points or ()):
        if set(point) != set(parameters):
            yield ("training", "parameters", "points", i), (
                f"give a value of each parameter: {', '.join(parameters)} "
                f"(got {', '.join(point)})")
