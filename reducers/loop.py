"""What the bordered iteration of one step keeps, and when its changes are round-off."""

from collections.abc import Sequence
from math import sqrt
from typing import Protocol

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import StepFormula
from sparsemor.core.separable import FrameWork
from sparsemor.reducers.acceptance import EPS, MARGIN, Scales, Tolerances
from sparsemor.reducers.body_step import BodyStep
from sparsemor.reducers.elastic import History


class Loop:
    """What one step keeps between its iterations: `given` targets of the constraints, rates of
    the stacked borders at y = 0, the border unknowns y and their last change dy, the border's
    matrix, and per body its unknowns c, z and what multiplies its directions (sigma). origin: what
    of the stacked borders is no unknown. changes: relative change of the rigid coordinates, then
    |du| of each body by its largest |u|; size: what the former is relative to."""

    __slots__ = ("acceleration", "c", "changes", "dy", "given", "history", "matrix", "origin",
                 "sigma", "size", "velocity", "y", "z")

    history: list[History | None]
    given: FloatArray
    origin: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    y: FloatArray
    dy: FloatArray
    matrix: FloatArray
    changes: list[float]
    size: float
    c: list[FloatArray]
    z: list[FloatArray]
    sigma: list[FloatArray]


class Bordered(Protocol):
    """The mechanical equations of one step, as far as round-off asks for them."""

    @property
    def bodies(self) -> Sequence[BodyStep]: ...
    @property
    def n_rigid(self) -> int: ...
    @property
    def tol(self) -> Tolerances: ...
    @property
    def work(self) -> Sequence[FrameWork]: ...


def rounded_off(equations: Bordered, step: StepFormula, loop: Loop, scales: Scales) -> bool:
    """Whether a change that no longer falls is round-off: no more than rounding the terms makes
    of the border unknowns, |B^-1| eps |B| |y|, and with them of the displacements."""
    nr, y, tol = equations.n_rigid, np.abs(loop.y), equations.tol.remaining
    size = max(1.0, sqrt(float(y[:nr].dot(y[:nr]))))
    y[:nr] = size
    inverse = dgesv(loop.matrix, np.eye(len(y)))[2]
    terms = np.abs(loop.matrix) @ y
    terms[nr:] = np.maximum(terms[nr:], size)  # constraints subtract positions from each other
    border = EPS * (np.abs(inverse) @ terms)
    if loop.changes[0] > tol and (
            loop.changes[0] * loop.size > MARGIN * float(np.linalg.norm(border[:nr]))):
        return False
    parts = zip(equations.bodies, equations.work, loop.history, loop.c, loop.changes[1:],
                scales.elastic, strict=True)
    for b, w, past, c, change, scale in parts:
        if b.block is None or past is None or change <= tol:
            continue
        noise = b.block.noise(c, past, w.coefficients, step.c1, step.c2)
        bent = sum(at * np.abs(b.block.update(np.zeros(1), sigma)) for at, sigma in zip(
            np.abs(b.to_border) @ border, w.sigma[:-1], strict=True))
        noise += float(np.linalg.norm(bent))
        if change * sqrt(scale) > MARGIN * noise:
            return False
    return True
