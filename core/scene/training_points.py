"""Points of the parameter box at which training runs are made: Latin hypercube, corners, or chosen
by estimated errors."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.scene.parameters import Parameter, Point

CENTRE = 0.5
"""Centre of a range, as a share of its width."""
SAMPLES = 9
"""Number of training runs unless the scene gives one."""


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
