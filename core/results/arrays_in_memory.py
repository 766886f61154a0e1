"""Result of a run that is kept in memory: its writer, and its arrays as a reader takes them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.result_variables import (
    Fixed,
    fixed_arrays,
    started_attributes,
    time_arrays,
)
from sparsemor.core.results.result_writer import ChunkOfSteps, check_column, columns_of, converted
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import ALL, array_entry
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class ArraysInMemory:
    """Arrays of one result in memory, read as those of a store (stored_arrays.py). arrays: name ->
    entry (`array_entry`); values: name -> array."""

    attributes: dict[str, Any]
    arrays: dict[str, dict[str, Any]]
    values: Mapping[str, NDArray[Any]]

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def shape(self, name: str) -> tuple[int, ...]:
        return self.values[name].shape

    def check(self) -> None:
        """Nothing can be missing."""

    def read(self, name: str, rows: slice | IntArray = ALL) -> NDArray[Any]:
        """Copy of the entries `rows` along the first axis of an array."""
        return self.values[name][rows].copy()


class MemoryWriter:
    """Writer of a result that stays in memory; fixed: arrays that do not depend on time.

    Arrays over time are kept in parts, one of each `append`, until the result is asked for.
    """

    def __init__(self, header: RunHeader, fixed: Fixed) -> None:
        self._layout, self._fixed = header.layout, fixed
        self._arrays = time_arrays(header)
        self._parts: list[dict[str, NDArray[Any]]] = []
        self._attributes = started_attributes(header)

    @property
    def attributes(self) -> Mapping[str, Any]:
        """Attributes of the result, as plain data."""
        return dict(self._attributes)

    def append(self, steps: ChunkOfSteps) -> None:
        """Takes steps. Raises ValueError for values that are not finite."""
        columns = columns_of(steps, self._layout, self._arrays)
        for name, values in columns.items():
            check_column(name, self._arrays[name], values, len(steps.times))
        self._parts.append(columns)

    def continued(self, header: RunHeader, maps: Mapping[str, FloatArray]) -> "MemoryWriter":
        """Writer of the same result in other unknowns of the step solver."""
        writer = MemoryWriter(header, fixed_arrays(header))
        writer._parts.append(converted(
            self.result(), writer._arrays, maps, slice(None)))
        return writer

    def checkpoint(
        self, arrays: Mapping[str, NDArray[Any]], memory: object = None, extra: int = 0
    ) -> None:
        """Nothing: a run in memory is not resumed."""

    def finish(self, status: Status, summary: Mapping[str, Any]) -> None:
        self._attributes.update(status=status.value, summary=dict(summary))

    def result(self) -> RunResult:
        """The result up to the last steps taken. _arrays: name -> entry of the arrays over time;
        _fixed: name -> (entry, values) of the others."""
        # shapes for a result without steps; afterwards all parts, one an `append`, are one
        empty = {name: np.zeros((0, *m["shape"][1:]), dtype=m["dtype"])
                 for name, m in self._arrays.items()}
        over_time = {name: np.concatenate([p[name] for p in self._parts] or [none])
                     for name, none in empty.items()}
        self._parts = [over_time]
        grown = {name: array_entry(
            values.shape, str(values.dtype), self._arrays[name]["dimensions"],
            self._arrays[name]["attributes"]) for name, values in over_time.items()}
        return RunResult.of(ArraysInMemory(
            self._attributes, grown | {n: m for n, (m, _) in self._fixed.items()},
            over_time | {n: values for n, (_, values) in self._fixed.items()}))
