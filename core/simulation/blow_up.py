"""Displacements far beyond their body, and temperatures beyond those of any material: the run is
stopped as `diverged`, with the likely cause."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np
from scipy.linalg import qr
from scipy.sparse.linalg import ArpackError, eigsh

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.poses import FREE_POSE
from sparsemor.core.protocols.reducer import OfflineProducts
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.time_stepping import FixedStep, iterate, problem_of, started
from sparsemor.core.status import SolveFailed, Status

BEYOND = 2.0
"""Largest displacement, relative to the diagonal of the body, that a run may have."""
HOTTEST, HOTTER = 1e6, 100.0
"""Temperature, K, and its ratio to the highest one at the start, that a run may not exceed both."""
TRIALS = 4000
"""Most steps of a trial run with half the step, which looks for the cause."""
SUDDEN, WITHIN = 100.0, 10
"""Growth of displacements within so many steps from which those beyond the smallest extent of a
body are suspected, and compared with a trial run."""
ENTRIES = 2**20
"""Number of displacements or temperatures that are computed from atoms together."""
SPINNING = 0.5
"""Share of the lowest natural frequency from which a spin is the likely cause."""


@dataclass(frozen=True, slots=True, eq=False)
class Large:
    """Displacements of a block, or where `hot` its temperatures, that are too large.

    size: largest displacement component, m, or temperature, K; diagonal: of the body's bounding
    box, m (of no use where hot).
    """

    block: str
    size: float
    diagonal: float
    hot: bool = False

    @property
    def detail(self) -> str:
        if self.hot:
            return f"temperatures of {self.size:.2g} K"
        return (f"displacements of {self.size:.2g} m in a body with a diagonal of "
                f"{self.diagonal:.3g} m")


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """One block of displacements, or where `hot` of temperatures, whose size is watched in a run.

    at: its unknowns c in the state vector; diagonal, extent: diagonal and smallest side of the
    body's bounding box, m, where hot the largest permitted temperature, K, over `BEYOND`, and that
    temperature itself. atoms (n, k), offset (n,): x = offset + atoms c, all rows or a few of them;
    None for a block that is not reduced. row: largest norm of a row of the atoms.
    """

    name: str
    at: slice
    diagonal: float
    extent: float
    atoms: FloatArray | None
    offset: FloatArray | None
    row: float
    hot: bool = False

    def exact(self, x: FloatArray) -> FloatArray:
        """Largest displacement component, m, or temperature, K, of each of j states with the
        unknowns x (j, n) of the solver."""
        c = x[:, self.at]
        if self.atoms is None or self.offset is None:
            largest: FloatArray = np.abs(c).max(axis=1, initial=0.0)
            return largest
        together = max(1, ENTRIES // max(1, len(self.atoms)))
        return np.concatenate([
            np.abs(self.offset + c[i : i + together] @ self.atoms.T).max(axis=1, initial=0.0)
            for i in range(0, len(c), together)])

    def with_few_rows(self) -> "Extent":
        """The same of as many rows as atoms, by pivoting: what a file without mesh holds. The
        largest of these rows is at most the largest of all."""
        if self.atoms is None or self.offset is None or not self.atoms.size:
            return self
        rows = qr(self.atoms.T, mode="r", pivoting=True)[1][: self.atoms.shape[1]]
        return replace(self, atoms=self.atoms[rows], offset=self.offset[rows])


@dataclass(frozen=True, eq=False)
class Extents:
    """Blocks of displacements with the diagonals of their bodies, and blocks of temperatures, whose
    `diagonal` is the largest permitted one over `BEYOND`."""

    blocks: tuple[Extent, ...]

    @classmethod
    def from_model(
        cls, model: Model | None, layout: Layout, dictionaries: Mapping[str, Dictionary]
    ) -> "Extents":
        """Extents of the bodies of a model, for unknowns in this layout; none without a mesh."""
        found = []
        if model is None:
            return cls(())
        for b in layout:
            if b.kind.quantity is Quantity.TEMPERATURE:
                found.append(_temperatures(model, layout, b.name, dictionaries.get(b.name)))
            if b.kind.quantity is not Quantity.DISPLACEMENT or b.name not in model.geometry:
                continue
            # points (n, d): node of each full-order unknown; a solver without mesh has other atoms
            points, d = model.geometry[b.name][0], dictionaries.get(b.name)
            diagonal = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
            if diagonal == 0.0 or (d is not None and len(d.atoms) != len(points)):
                continue
            extent = float(np.ptp(points, axis=0).min())
            found.append(Extent(
                b.name, layout[b.name], diagonal, extent, None if d is None else d.atoms,
                None if d is None else d.offset, _row(d)))
        return cls(tuple(found))

    def with_few_rows(self) -> "Extents":
        """The same with few rows of the atoms (`Extent.with_few_rows`)."""
        return Extents(tuple(b.with_few_rows() for b in self.blocks))

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Weights (n, blocks) of squared unknowns c in the squared bounds row^2 |c|^2 of atoms c of
        all blocks, n up to the last unknown of one with atoms; and the largest of these bounds
        (blocks,) for which nothing is computed from atoms. 0 and -1 for blocks without atoms, so
        that these are computed always."""
        of_atoms = [b.atoms is not None and b.offset is not None for b in self.blocks]
        n = max((b.at.stop for b, yes in zip(self.blocks, of_atoms, strict=True) if yes), default=0)
        weights = np.zeros((n, len(self.blocks)))
        for i, b in enumerate(self.blocks):
            if of_atoms[i]:
                weights[b.at, i] = b.row**2
        return weights, np.array([0.1 * b.extent if yes else -1.0 for b, yes in zip(
            self.blocks, of_atoms, strict=True)])

    def sizes(self, x: FloatArray) -> FloatArray:
        """Largest displacement component, m, or temperature, K, of each block (j, blocks) of j
        states with the unknowns x (j, n); where coefficients c are small (`_bounds`), the bound
        row |c| of atoms c in its place."""
        weights, small = self._bounds
        part = x[:, : len(weights)]
        found: FloatArray = np.sqrt((part * part) @ weights)
        within = found <= small
        if not within.all():
            for k in np.flatnonzero(~within.all(axis=0)).tolist():
                large = ~within[:, k]
                found[large, k] = self.blocks[k].exact(x[large])
        return found

    def exceeded(self, sizes: FloatArray) -> Large | None:
        """The first block with displacements beyond its body or temperatures beyond any material,
        in a state of these sizes (blocks,)."""
        for b, size in zip(self.blocks, sizes.tolist(), strict=True):
            if size > BEYOND * b.diagonal:
                return Large(b.name, size, b.diagonal, b.hot)
        return None


def _row(d: Dictionary | None) -> float:
    """Largest norm of a row of the atoms."""
    return 0.0 if d is None else float(np.sqrt((d.atoms**2).sum(axis=1).max(initial=0.0)))


def _temperatures(model: Model, layout: Layout, name: str, d: Dictionary | None) -> Extent:
    """Temperatures of a block, with the largest ones that a run may have."""
    start = float(np.abs(model.x0[model.layout[name]]).max(initial=0.0))
    most = max(HOTTEST, HOTTER * start)
    return Extent(name, layout[name], most / BEYOND, most, None if d is None else d.atoms,
                  None if d is None else d.offset, _row(d), hot=True)


class Limits:
    """Sizes of the displacements and temperatures of the steps of a run, for those that are too
    large, and for sudden growth beyond a body's smallest extent. extents: of its blocks."""

    def __init__(self, extents: Extents) -> None:
        """_before: sizes (blocks,) in up to `WITHIN` last steps."""
        self.extents, self._before = extents, list[FloatArray]()
        # from which on a size may be too large, or suspected
        self._suspected = np.array([
            BEYOND * b.diagonal if b.hot else min(BEYOND * b.diagonal, b.extent)
            for b in extents.blocks])

    def of(self, extents: Extents) -> "Limits":
        """Limits of the same run in other unknowns of its step solver."""
        made = Limits(extents)
        if [b.name for b in extents.blocks] == [b.name for b in self.extents.blocks]:
            made._before = self._before
        return made

    def found(self, x: FloatArray) -> Mapping[int, tuple[Large | None, Large | None]]:
        """Number, from 0 on, of each of the next j steps, with the unknowns x (j, n), whose sizes
        are suspected -> what is too large in it, and what has grown suddenly, None for neither."""
        sizes, before = self.extents.sizes(x), self._before
        self._before = [*before, *sizes[-WITHIN:]][-WITHIN:]
        if (sizes <= self._suspected).all():
            return {}
        rows = [*before, *sizes]
        first = len(before) - WITHIN  # row that is `WITHIN` steps before the first one
        return {i: (self.extents.exceeded(sizes[i]),
                    self._sudden(sizes[i], rows[first + i]) if first + i >= 0 else None)
                for i in np.flatnonzero(~(sizes <= self._suspected).all(axis=1)).tolist()}

    def _sudden(self, sizes: FloatArray, before: FloatArray) -> Large | None:
        """The first block whose displacements exceed the body's smallest extent and `SUDDEN` times
        those of `WITHIN` steps before. sizes, before: (blocks,)."""
        for b, size, small in zip(
                self.extents.blocks, sizes.tolist(), before.tolist(), strict=True):
            if 0.0 < small and size > max(b.extent, SUDDEN * small) and not b.hot:
                return Large(b.name, size, b.diagonal)
        return None


def too_long(
    scene: Scene, model: Model, offline: OfflineProducts, start: State, t: float, large: Large
) -> SolveFailed | None:
    """The failure of a run with a sudden growth up to the time t (s) that half the step does not
    have; None where it has."""
    h = scene.time.step
    if not _smaller(scene, model, offline, start, 0.5 * h, round(2.0 * t / h), 0.1 * large.size):
        return None
    return SolveFailed(Status.DIVERGED, t, large.block, large.detail, advice=_too_long(h))


def _too_long(h: float) -> str:
    return (f"the time step is too long: with {0.5 * h:.3g} s this does not happen until this "
            "time; take a time.step several times smaller, or time.control")


def diverged(
    scene: Scene, model: Model, offline: OfflineProducts, start: State, now: State, large: Large,
    phase: str = "run"
) -> SolveFailed:
    """The failure of a run whose displacements or temperatures are too large at the state `now`
    (full-order or reduced), with advice by what is found: a trial with half the step from the
    full-order state `start`, and the spin against the lowest natural frequency. large: what is too
    large; phase: name of the run in messages."""
    h = scene.time.step
    if _smaller(scene, model, offline, start, 0.5 * h, round(2.0 * now.t / h)):
        advice = _too_long(h)
    elif large.hot:
        advice = ("half the step does not help: check the heat of loads, conductances, k, c, rho, "
                  "the thickness and units (W, m, kg, K)")
    else:
        advice = _spinning(model, now, large.block) or (
            "half the step does not help, and no spin does this: check the loads, E, the "
            "thickness, units (m, N, kg) and joints")
    return SolveFailed(Status.DIVERGED, now.t, large.block, large.detail, phase=phase,
                       advice=advice)


def _smaller(
    scene: Scene, model: Model, offline: OfflineProducts, start: State, h: float, count: int,
    most: float = inf
) -> bool:
    """True if displacements stay within the bodies, and below `most`, m, in `count` steps of h, s,
    from the full-order state `start`. False, without a trial, for more than `TRIALS` steps or
    steps of controlled error."""
    if count > TRIALS or scene.time.control is not None:
        return False
    try:
        solver: StepSolver = scene.reducer.prepare(problem_of(scene, model, offline, h))
        state, memory = started(solver, scene.integrator, start)
        extents = Extents.from_model(model, solver.layout, solver.dictionaries)
        for taken in iterate(FixedStep.of(scene.integrator, solver, h), state, memory, count):
            sizes = extents.sizes(taken.state.x[None])[0]
            if not taken.outcome.status.ok or extents.exceeded(sizes) or any(
                    size > most for b, size in zip(extents.blocks, sizes, strict=True)
                    if not b.hot):
                return False
    except SolveFailed:
        return False
    return True


def _spinning(model: Model, now: State, block: str) -> str:
    """Advice where the body of a block turns near its lowest natural frequency, faster than
    SPINNING times that; "" otherwise."""
    for m in model.separated.moving:
        if m.elastic != block or m.operators is None:
            continue
        pose = model.layout.of(m.name, Quantity.POSE)
        if pose is None:
            return ""
        # rigid coordinates come first in full and reduced states; |w| = 2 |q'|, q: quaternion
        rate = now.v[: model.layout.frames.stop][model.layout[pose.name]]
        w = abs(float(rate[-1])) if pose.size != FREE_POSE else 2.0 * float(
            np.linalg.norm(rate[3:]))
        try:
            lowest = float(eigsh(
                m.operators.stiffness, k=1, M=m.operators.mass, sigma=0.0, tol=1e-2,
                return_eigenvectors=False)[0]) ** 0.5
        except (ArpackError, RuntimeError, ValueError):  # rigid motion, or a body of few unknowns
            return ""
        if w > SPINNING * lowest:
            return (f"the body turns at {w:.4g} rad/s, {w / lowest:.2g} of its lowest natural "
                    f"frequency {lowest:.4g} rad/s: linear strains have no stiffness by spin; take "
                    "strains: nonlinear, a slower spin or a stiffer body")
    return ""

