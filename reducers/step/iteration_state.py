"""State and working arrays of the bordered Newton iteration within one step, and its round-off."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Frame
from sparsemor.reducers.step.acceptance import EPS, MARGIN, Tolerances
from sparsemor.reducers.step.blocks.elastic_block import History
from sparsemor.reducers.step.blocks.thermal_block import HeatJacobian
from sparsemor.reducers.step.border.system import BodyMatrices, BorderedSystem
from sparsemor.reducers.step.frame_step import BodyStep, buffers
from sparsemor.reducers.step.loop import StepEquations


class EliminationState:
    """State of one step between its iterations.

    targets: prescribed values of the constraints; predicted, d (N,): border unknowns of the model
    and their increments, dy: last change of these; acceleration: predicted rigid accelerations
    over c2;
    border, now: stacked border unknowns of the bodies with first and second rates, at d = 0 and at
    d; matrix: bordered matrix as its system stores it; u: increments of the elastic unknowns of
    each body. changes: relative change of
    the rigid coordinates, then |du| of each body relative to its largest |u|; size: reference
    magnitude of the former, reference: of the latter; distance: squared distance of each body from
    the origin.
    """

    __slots__ = ("acceleration", "border", "changes", "d", "distance", "dy", "history", "matrix",
                 "now", "predicted", "reference", "size", "targets", "u")

    history: list[History | None]
    targets: FloatArray
    acceleration: FloatArray
    predicted: FloatArray
    border: tuple[FloatArray, FloatArray, FloatArray]
    now: tuple[FloatArray, FloatArray, FloatArray]
    d: FloatArray
    dy: FloatArray
    matrix: FloatArray
    changes: list[float]
    size: float
    reference: list[float]
    distance: list[float]
    u: list[FloatArray]


class Workspace:
    """Working arrays of the mechanical steps of one run: frame quantities of each body, border
    matrices H of all bodies, and the final iteration state of the last step. Each solve
    overwrites them; they contain no state of the run, nor do the kept Jacobians of thermal blocks,
    `heat`, which can be computed again. equations: those of a reduced model. Each thread needs its
    own."""

    __slots__ = ("H", "equations", "frames", "heat", "loop", "of", "system")

    def __init__(
        self, frames: Sequence[Frame], system: BorderedSystem | None,
        equations: StepEquations | None = None,
    ) -> None:
        self.equations = equations
        self.of, self.frames, self.system = tuple(frames), buffers(frames), system
        self.H = BodyMatrices(np.zeros(0), []) if system is None else system.matrices()
        self.loop: EliminationState | None = None
        self.heat: dict[str, HeatJacobian] = {}

    def separate(self) -> "Workspace":
        """New arrays of the same sizes."""
        return Workspace(self.of, self.system, self.equations and self.equations.working())

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
    def at(self) -> Sequence[slice]:
        """Range of each body among the stacked border unknowns."""
        ...

    @property
    def n_rigid(self) -> int: ...
    @property
    def system(self) -> BorderedSystem: ...
    @property
    def turning(self) -> BoolArray:
        """(n_rigid,) True for rigid coordinates that are no positions."""
        ...
    @property
    def tol(self) -> Tolerances: ...


def rounded_off(
    equations: Bordered, loop: EliminationState, work: Workspace
) -> bool:
    """True if a change that no longer decreases is round-off: not above the effect of rounding the
    terms on the border unknowns, |B^-1| eps |terms| with the bordered matrix B, and through these
    on the displacements.

    Forces are as large as those of the accelerations and multipliers; constraints subtract
    positions from each other, each exact to eps of its size.
    """
    nr, tol = equations.n_rigid, equations.tol.remaining
    system, B, y = equations.system, loop.matrix, np.abs(loop.predicted + loop.d)
    moved = float(np.linalg.norm(loop.acceleration)) + float(np.linalg.norm(loop.d[:nr]))
    forces, places = y.copy(), np.zeros(len(y))
    forces[:nr], places[:nr] = moved, np.where(equations.turning, 1.0, y[:nr])
    terms = system.term_sizes(B, forces)
    terms[nr:] = system.term_sizes(B, places)[nr:]
    border = EPS * system.amplified(B, terms)
    if loop.changes[0] > tol and (
            loop.changes[0] * loop.size > MARGIN * float(np.linalg.norm(border[:nr]))):
        return False
    shares = system.stacked_sizes(border)
    parts = zip(equations.bodies, equations.at, work.frames, loop.history, loop.u,
                loop.changes[1:], loop.reference, strict=True)
    for b, at, w, past, d, change, scale in parts:
        if b.block is None or past is None or change <= tol:
            continue
        noise = b.block.noise(d, past, w.coefficients)
        bent = sum(share * np.abs(b.block.response(sigma)) for share, sigma in zip(
            shares[at], w.sigma[:-1], strict=True))
        noise += float(np.linalg.norm(bent))
        if change * scale > MARGIN * noise:
            return False
    return True
