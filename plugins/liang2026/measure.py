"""Base classes of the quantities of a paper file, and the results that they read."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol

import numpy as np

from sparsemor.core.registry.plugin import Plugin
from sparsemor.core.results.error_norms import Errors
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.liang2026.rules import Operand

Statistic = Literal["max", "min", "mean", "median", "last", "first"]
_STATISTICS: Mapping[str, Any] = {
    "max": np.max, "min": np.min, "mean": np.mean, "median": np.median,
    "last": lambda v: v[-1], "first": lambda v: v[0]}


class Results(Protocol):
    """Completed runs and studies of a reproduction, by name."""

    def run(self, name: str) -> RunResult: ...
    def rows(self, study: str) -> Sequence[Mapping[str, Any]]: ...
    def errors(self, reference: str, run: str) -> Errors: ...
    def split(self, run: str) -> Mapping[str, float]: ...


class Measure(Plugin):
    """Base class of quantities: a frozen description that computes one number or text."""

    def runs(self) -> tuple[str, ...]:
        """Names of the runs that it reads."""
        return ()

    def studies(self) -> tuple[str, ...]:
        """Names of the studies that it reads."""
        return ()

    def rows(self) -> tuple[Mapping[str, Any], ...]:
        """Column -> value of the rows that it reads, of each study."""
        return ()

    def profiled(self) -> tuple[str, ...]:
        """Names of the runs whose computing time it divides."""
        return ()

    @abstractmethod
    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        """Value; known: values of the item computed before. Raises InputError if the run lacks the
        data."""


class OfRun(Measure):
    """Base class of quantities of one run."""

    run: str
    """Name of the run."""

    def runs(self) -> tuple[str, ...]:
        return (self.run,)


def statistic(name: Statistic, values: Any) -> float:
    """Statistic of some numbers, such as `median`."""
    return float(_STATISTICS[name](values))
