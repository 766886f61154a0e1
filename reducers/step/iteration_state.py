"""State of the bordered iteration within one step, its working arrays, and its round-off."""

from collections.abc import Sequence
from math import sqrt
from typing import Protocol

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core import FloatArray, Frame, StepFormula
from sparsemor.reducers.step.acceptance import EPS, MARGIN, Scales, Tolerances
from sparsemor.reducers.step.elastic_block import History
from sparsemor.reducers.step.frame_step import BodyStep, buffers


class Loop:
    """State of one step between its iterations: targets of the constraints, rates of
    the stacked borders at y = 0, the border unknowns y and their last change dy, the border's
    matrix, and per body its unknowns c, z and what multiplies its directions (sigma). origin: what
    of the stacked borders is no unknown. changes: relative change of the rigid coordinates, then
    |du| of each body by its largest |u|; size: what the former is relative to."""

    __slots__ = ("acceleration", "c", "changes", "dy", "history", "matrix", "origin",
                 "sigma", "size", "targets", "velocity", "y", "z")

    history: list[History | None]
    targets: FloatArray
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


class Workspace:
    """Working arrays of the mechanical steps of one run: what each body's frame fills, the stacked
    border H with its rows, and what the last step ended with. Each solve overwrites them; nothing
    in them is state of the run. Two threads need two of them."""

    __slots__ = ("H", "frames", "loop", "of", "rows")

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.of, self.frames = tuple(frames), buffers(frames)
        size = sum(f.border for f in frames)
        self.H, self.rows = np.zeros((size, size)), np.zeros(size)
        self.loop: Loop | None = None

    def separate(self) -> "Workspace":
        """Arrays of the same sizes."""
        return Workspace(self.of)

    def linear_iterations(self, bodies: Sequence[BodyStep]) -> dict[str, int]:
        """Elastic block -> iterations of its linear solver in the last step; none: left out."""
        if self.loop is None:
            return {}
        return {b.elastic_name: past.iterations
                for b, past in zip(bodies, self.loop.history, strict=True)
                if past is not None and past.iterations}


class Bordered(Protocol):
    """The mechanical equations of one step, as far as round-off asks for them."""

    @property
    def bodies(self) -> Sequence[BodyStep]: ...
    @property
    def n_rigid(self) -> int: ...
    @property
    def tol(self) -> Tolerances: ...


def rounded_off(
    equations: Bordered, step: StepFormula, loop: Loop, scales: Scales, work: Workspace
) -> bool:
    """True if a change that no longer falls is round-off: no more than rounding the terms makes
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
    parts = zip(equations.bodies, work.frames, loop.history, loop.c, loop.changes[1:],
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
