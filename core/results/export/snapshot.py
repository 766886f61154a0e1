"""One body at one time, as other programs take it: three coordinates, space axes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """points (N, 3): where the points are, m; fields: name -> (N,) or (N, 3)."""

    points: FloatArray
    fields: Mapping[str, FloatArray]


def frame_at(run: RunResult, body: str, step: int, fields: Sequence[str]) -> Frame:
    """Points at R + A (X + u); the displacement is A u, so that what warps points by it magnifies
    the deformation. Plane bodies lie in z = 0."""
    u = run.nodal_displacement(body, step)
    values: dict[str, FloatArray] = {}
    if "displacement" in fields:
        values["displacement"] = _in_three(run.turned(body, step, u))
    if "temperature" in fields:
        values["temperature"] = run.nodal_temperature(body, step)
    return Frame(_in_three(run.in_space(body, step, run.points(body) + u)), values)


def _in_three(vectors: FloatArray) -> FloatArray:
    """(N, 3) of (N, 2) or (N, 3)."""
    return np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1]))))
