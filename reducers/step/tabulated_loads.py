"""Tabulated moving loads on prepared unknowns: one row of a table per step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Table


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedLoads:
    """left (s, m) @ table.at(t), for tables (T, m) of tested rows."""

    table: Table
    left: FloatArray

    def at(self, t: float) -> FloatArray:
        """(s,)"""
        return np.asarray(self.left.dot(self.table.at(t)))

    def along(self, times: FloatArray) -> FloatArray:
        """(T, s)"""
        return np.asarray(self.table.along(times).dot(self.left.T))


Moving = Table | TabulatedLoads
"""What has a value (s,) `at` each time."""


def tabulated(tables: Sequence[Table], left: FloatArray, for_good: bool) -> tuple[Moving, ...]:
    """Applied to all times at once where the arrays stay for the whole run; a support that may
    change with the next step does not pay for that."""
    return tuple(t.through(left) if for_good else TabulatedLoads(t, left) for t in tables)
