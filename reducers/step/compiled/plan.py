"""Arrays of a model for compiled steps, made from its step solver."""

from dataclasses import dataclass
from math import comb

import numpy as np

from sparsemor.core import (
    Amplitude,
    FloatArray,
    FrameArrays,
    HasArrays,
    IntArray,
    Layout,
    UpdateRules,
)
from sparsemor.reducers.step.blocks.compressed_elastic import CompressedElastic
from sparsemor.reducers.step.blocks.compressed_prescribed import CompressedPrescribed
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, ReducedLocal
from sparsemor.reducers.step.blocks.thermal_block import CompressedHeat, HeatBlock
from sparsemor.reducers.step.compiled.arrays import (
    BodyArrays,
    BodyWork,
    HeatArrays,
    ModelArrays,
    PrescribedArrays,
)
from sparsemor.reducers.step.compiled.compile import Called, Functions
from sparsemor.reducers.step.compiled.local import NO_LOCAL, LocalArrays
from sparsemor.reducers.step.compiled.local_plan import local_arrays, points_of
from sparsemor.reducers.step.compiled.timed import NotCompiled, Timed
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.predictor import block_starts
from sparsemor.reducers.step.prescribed_frames import PrescribedFrames
from sparsemor.reducers.step.solver import Stepper

LARGEST_BORDER = 60
"""Largest number of border unknowns of compiled steps, which solve a dense system."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Arrays of a model for compiled steps. bodies, prescribed: those with unknown motion, or those
    with prescribed motion; frame: function of the frames of the former; laws: functions of the laws
    of local terms; timed: functions of time; targets: numbers of border unknowns with the functions
    that prescribe them; border: number of border unknowns."""

    heat: tuple[HeatArrays, ...]
    bodies: tuple[BodyArrays, ...]
    prescribed: tuple[PrescribedArrays, ...]
    frame: FrameArrays | None
    laws: tuple[Called, ...]
    timed: Timed
    targets: tuple[tuple[int, Amplitude], ...]
    border: int

    @property
    def functions(self) -> Functions:
        """Functions that belong to the model, with which the steps are compiled."""
        frame = None if self.frame is None else (self.frame.function, self.frame.calls)
        return Functions(frame, self.laws)

    def targets_along(self, times: FloatArray) -> FloatArray:
        """Prescribed values of the constraints (T, N) at times (T,), s."""
        found = np.zeros((len(times), self.border))
        for i, f in self.targets:
            found[:, i] += [f(t) for t in times.tolist()]
        return found


def plan(s: Stepper) -> Plan:
    """Arrays for the steps of `s`. Raises NotCompiled, with the reason, where its model contains
    what compiled steps do not."""
    mechanics, timed, laws = s.mechanics, Timed(), list[Called]()
    if mechanics is None:
        raise NotCompiled("the model has no step of its own blocks")
    heat = tuple(_heat(where, s.heat[name], name, timed, laws) for name, where in s.hot)
    if isinstance(mechanics, PrescribedFrames):
        moved = tuple(_prescribed(i, b, timed, laws) for i, b in enumerate(mechanics.bodies)
                      if b.prescribed is not None)
        return Plan(heat, (), moved, None, tuple(laws), timed, (), 0)
    if mechanics.size > LARGEST_BORDER:
        raise NotCompiled(f"{mechanics.size} rigid coordinates and joint forces")
    frames = [_frame(b) for b in mechanics.bodies]
    if len({f.function for f in frames}) > 1:
        raise NotCompiled("frames with different functions")
    bodies = tuple(
        _body(b, f, timed, laws) for b, f in zip(mechanics.bodies, frames, strict=True))
    return Plan(heat, bodies, (), frames[0], tuple(laws), timed, mechanics.targets, mechanics.size)


def _frame(b: BodyStep) -> FrameArrays:
    made = b.frame.arrays() if isinstance(b.frame, HasArrays) else None
    if made is None:
        raise NotCompiled(f"the frame of body {b.name} is not given as arrays")
    return made


def _array(values: FloatArray) -> FloatArray:
    """A contiguous array that may be written to."""
    return np.array(values, dtype=np.float64, order="C")


def _split(start: int, k: int, active: IntArray | None) -> tuple[IntArray, IntArray]:
    """Numbers of the active and of the other unknowns of a block of k."""
    use = np.arange(k) if active is None else active
    return start + use.astype(np.int64), start + np.setdiff1d(np.arange(k), use).astype(np.int64)


def _heat(
    where: slice | IntArray, block: HeatBlock, name: str, timed: Timed, laws: list[Called]
) -> HeatArrays:
    if not isinstance(block, CompressedHeat):
        raise NotCompiled(f"{name} is of full order")
    at = np.arange(where.start, where.stop) if isinstance(where, slice) else where
    active, idle = _split(0, len(at), block.active)
    loads = block.loads
    return HeatArrays(
        at.astype(np.int64), at[active].astype(np.int64), at[idle].astype(np.int64),
        _array(np.atleast_2d(block.by_rate)), _array(np.atleast_2d(block.by_value)),
        _array(loads.base), _array(loads.loads), timed.amplitudes(loads.amplitudes),
        timed.tables(loads.tables),
        local_arrays(points_of(block.local, name), active, laws, timed), block.rtol,
        block.max_iterations)


def _forces(
    local: LocalForces | None, name: str, active: IntArray, laws: list[Called], timed: Timed
) -> tuple[LocalArrays, LocalArrays]:
    """Local terms of displacements that depend on temperatures alone, and the others."""
    if local is None:
        return NO_LOCAL, NO_LOCAL
    if not isinstance(local, ReducedLocal):
        raise NotCompiled(f"{name} is of full order")
    still, moving = (local_arrays(points_of(terms, name), active, laws, timed)
                     for terms in (local.still, local.moving))
    return still, moving


def _body(b: BodyStep, f: FrameArrays, timed: Timed, laws: list[Called]) -> BodyArrays:
    rows, columns = (i.astype(np.int64) for i in np.nonzero(b.to_border))
    gains = np.array([-1 if a is None else timed.amplitudes([a]) for a in f.amplitudes],
                     dtype=np.int64)
    n = b.frame.rigid_size
    frame = (f.kinds.copy(), _array(f.numbers), f.starts.copy(), gains, rows, columns,
             _array(b.to_border[rows, columns]), _array(b.origin), timed.motion(b.guide, n), n,
             min(3, n - 1))
    e = b.block
    if e is None:
        none, matrix, numbers = np.zeros(0), np.zeros((0, 0)), np.zeros(0, dtype=np.int64)
        return BodyArrays(*frame, 0, 0, numbers, numbers, 0, 0, 0, matrix, none, matrix, matrix,
                          matrix, matrix, matrix, -1, -1, NO_LOCAL, NO_LOCAL)
    if not isinstance(e, CompressedElastic):
        raise NotCompiled(f"{b.elastic_name} is of full order")
    k, kt = b.elastic.stop - b.elastic.start, b.thermal.stop - b.thermal.start
    active, idle = _split(b.elastic.start, k, e.active)
    inputs = 3 * k + kt
    return BodyArrays(
        *frame, b.elastic.start, k, active, idle, b.thermal.start, kt, e.sizes[2],
        _array(e.H[:, :inputs]), _array(e.base), _array(e.H[:, inputs:]), _array(e.S.T),
        _array(e.S[:, active - b.elastic.start]), _array(e.E), _array(e.G.T),
        timed.amplitudes(e.amplitudes), timed.tables(e.tables),
        *_forces(e.local, b.elastic_name, active - b.elastic.start, laws, timed))


def _prescribed(
    number: int, b: BodyStep, timed: Timed, laws: list[Called]
) -> PrescribedArrays:
    e, table = b.prescribed, b.table
    if not isinstance(e, CompressedPrescribed) or table is None:
        raise NotCompiled(f"{b.elastic_name} is of full order")
    k, kt = b.elastic.stop - b.elastic.start, b.thermal.stop - b.thermal.start
    active, idle = _split(b.elastic.start, k, e.active)
    width = 2 * len(e.G) + e.E.shape[1] + 1 + len(e.base)
    return PrescribedArrays(
        number, b.elastic.start, k, active, idle, b.thermal.start, kt,
        _array(np.atleast_2d(e.inertia)), _array(np.atleast_2d(e.stiffness)),
        np.zeros((0, k)) if e.damping is None else _array(np.atleast_2d(e.damping)),
        _array(e.coupling), _array(e.G), _array(e.leading), timed.table(table, width), width,
        *_forces(e.local, b.elastic_name, active - b.elastic.start, laws, timed))


def model_arrays(s: Stepper, rules: UpdateRules) -> ModelArrays:
    """Constants of the model of `s` for an integrator with these rules."""
    layout: Layout = s.layout
    bodies = () if s.mechanics is None or isinstance(s.mechanics, PrescribedFrames) else (
        s.mechanics.bodies)
    c1, c2, c1_first = rules.factors
    weights = np.zeros((s.points + 1, s.points))
    for order in range(1, s.points + 1):
        for j in range(order):
            weights[order, j] = (-1) ** j * comb(order, j + 1)

    def ends(at: slice) -> IntArray:
        return np.array([at.start, at.stop], dtype=np.int64)

    return ModelArrays(
        ends(layout.second), ends(layout.first), ends(layout.algebraic),
        np.array([ends(b.elastic) for b in bodies], dtype=np.int64).reshape(-1, 2),
        _array(rules.second.new), _array(rules.second.old), _array(rules.first.new),
        _array(rules.first.old), c1, c2, c1_first, layout.frames.stop,
        np.array([*block_starts(layout), layout.size], dtype=np.int64), weights,
        _array(s.sanity), s.tolerances.remaining, s.tolerances.max_iterations)


def work_of(b: BodyArrays) -> BodyWork:
    """Working arrays for one body."""
    n, p, w, s = len(b.origin), len(b.Gt), len(b.base), len(b.active)
    rows = len(b.step_products)
    return BodyWork(
        np.zeros((n + 1, p)), np.zeros((n, p)), np.zeros((n, n + 1)), np.zeros(2 * b.g + 1),
        np.zeros((3, p)), np.zeros(3 * b.g), np.zeros(len(b.gains)), np.zeros((3, n)),
        np.zeros((3, n)), np.zeros(3 * b.k + b.kt), np.zeros((3, rows)), np.zeros(rows),
        np.zeros(w), np.zeros(w), np.zeros(s), np.zeros(s),
        np.zeros(len(b.local.offset)), np.zeros(len(b.local.offset)))
