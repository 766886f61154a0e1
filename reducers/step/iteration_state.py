"""State and working arrays of the bordered Newton iteration within one step, and its round-off."""

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
    """State of one step between its iterations.

    targets: prescribed values of the constraints; velocity, acceleration: rates of the stacked
    border unknowns at y = 0; origin: their prescribed part; y, dy: border unknowns of the model and
    their last change; matrix: bordered matrix; c, z, sigma: of each body, elastic unknowns, z
    (elastic_block.py) and factors of the frame directions. changes: relative change of the rigid
    coordinates, then |du| of each body relative to its largest |u|; size: reference magnitude of
    the former.
    """

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
    """Working arrays of the mechanical steps of one run: frame quantities of each body, the stacked
    border matrix H with its rows, and the final iteration state of the last step. Each solve
    overwrites them; they contain no state of the run. Each thread needs its own."""

    __slots__ = ("H", "frames", "loop", "of", "rows")

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.of, self.frames = tuple(frames), buffers(frames)
        size = sum(f.border for f in frames)
        self.H, self.rows = np.zeros((size, size)), np.zeros(size)
        self.loop: Loop | None = None

    def separate(self) -> "Workspace":
        """New arrays of the same sizes."""
        return Workspace(self.of)

    def linear_iterations(self, bodies: Sequence[BodyStep]) -> dict[str, int]:
        """Elastic block -> iterations of its linear solver in the last step; blocks without are
        left out."""
        if self.loop is None:
            return {}
        return {b.elastic_name: past.iterations
                for b, past in zip(bodies, self.loop.history, strict=True)
                if past is not None and past.iterations}


class Bordered(Protocol):
    """Mechanical equations of one step, as needed for the estimate of round-off."""

    @property
    def bodies(self) -> Sequence[BodyStep]: ...
    @property
    def n_rigid(self) -> int: ...
    @property
    def tol(self) -> Tolerances: ...


def rounded_off(
    equations: Bordered, step: StepFormula, loop: Loop, scales: Scales, work: Workspace
) -> bool:
    """True if a change that no longer decreases is round-off: not above the effect of rounding the
    terms on the border unknowns, |B^-1| eps |B| |y| with the bordered matrix B, and through these
    on the displacements."""
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
