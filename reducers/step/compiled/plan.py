"""Arrays of a model for compiled steps, made from its step solver."""

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray, Layout, UpdateRules
from sparsemor.core.protocols import FrameArrays, Held
from sparsemor.reducers.linalg.modal_coordinates import carried
from sparsemor.reducers.step.blocks.compressed_elastic import CompressedElastic
from sparsemor.reducers.step.blocks.elastic_block import ElasticBlock
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, ReducedLocal
from sparsemor.reducers.step.blocks.thermal_block import CompressedHeat, HeatBlock
from sparsemor.reducers.step.compiled.arrays import (
    BodyArrays,
    BodyTerms,
    HeatArrays,
    ModelArrays,
    PrescribedArrays,
)
from sparsemor.reducers.step.compiled.compile import Called, Functions
from sparsemor.reducers.step.compiled.local import NO_LOCAL, LocalArrays
from sparsemor.reducers.step.compiled.local_plan import local_arrays, points_of
from sparsemor.reducers.step.compiled.stacked import NO_BODY, array, by_four, number, stacked
from sparsemor.reducers.step.compiled.timed import NotCompiled, Timed
from sparsemor.reducers.step.driven import Driven
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.predictor import block_starts
from sparsemor.reducers.step.reduced import Reduced
from sparsemor.reducers.step.reduced_mechanics import Mechanics, ReducedMechanics
from sparsemor.reducers.step.solver import Stepper
from sparsemor.reducers.step.time_tables import TimeTable

LARGEST_BORDER = 150
"""Largest number of border unknowns of compiled steps, which solve a dense system."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Arrays of a model for compiled steps. hot: names of the thermal blocks `heat`; bodies, terms:
    all bodies with unknown motion, and their local terms; prescribed: each with prescribed motion;
    frame: function of the frames of the former; laws: functions of the laws of local terms; timed:
    functions of time; targets: numbers of border unknowns with the functions that prescribe them;
    border: number of border unknowns; mechanics: the equations that the arrays are made from."""

    hot: tuple[str, ...]
    heat: tuple[HeatArrays, ...]
    bodies: BodyArrays
    terms: tuple[BodyTerms, ...]
    prescribed: tuple[PrescribedArrays, ...]
    frame: FrameArrays | None
    laws: tuple[Called, ...]
    timed: Timed
    targets: tuple[tuple[int, Amplitude], ...]
    border: int
    mechanics: Mechanics

    @property
    def functions(self) -> Functions:
        """Functions that belong to the model, with which the steps are compiled."""
        frame = None if self.frame is None else (self.frame.function, self.frame.calls)
        return Functions(frame, self.laws)

    def targets_along(self, times: FloatArray) -> FloatArray:
        """Prescribed values of the constraints (T, N) at times (T,), s."""
        found = np.zeros((len(times), self.border))
        for i, f in self.targets:
            found[:, i] += f.level if isinstance(f, Held) else [f(t) for t in times.tolist()]
        return found


def plan(s: Stepper, c1: float = 1.0, c2: float = 1.0) -> Plan:
    """Arrays for the steps of `s` with these factors. Raises NotCompiled, with the reason, where
    its model contains what compiled steps do not."""
    mechanics, timed, laws = s.mechanics, Timed(), list[Called]()
    if mechanics is None:
        raise NotCompiled("the model has no step of its own blocks")
    if s.warming:
        raise NotCompiled("the model has blocks at full order")
    hot = tuple(name for name, _ in s.hot)
    heat = tuple(_heat(where, s.heat[name], name, timed, laws) for name, where in s.hot)
    if isinstance(mechanics, ReducedMechanics) and not mechanics.size:
        moved = tuple(_prescribed(mechanics.equations, i, c1, timed, laws)
                      for i in range(len(mechanics.equations.driven)))
        return Plan(hot, heat, stacked(()), (), moved, None, tuple(laws), timed, (), 0,
                    mechanics)
    if not mechanics.size:
        raise NotCompiled("bodies of full order")
    if mechanics.size > LARGEST_BORDER:
        raise NotCompiled(f"{mechanics.size} rigid coordinates and joint forces")
    frames = [_frame(b) for b in mechanics.bodies]
    if len({f.function for f in frames}) > 1:
        raise NotCompiled("frames with different functions")
    terms: list[BodyTerms] = []
    bodies = [_body(i, replace(b, block=_condensed(s, b, c1, c2)), f, timed, laws, terms)
              for i, (b, f) in enumerate(zip(mechanics.bodies, frames, strict=True))]
    return Plan(hot, heat, stacked(bodies), tuple(terms), (), frames[0], tuple(laws), timed,
                mechanics.targets, mechanics.size, mechanics)


def _condensed(s: Stepper, b: BodyStep, c1: float, c2: float) -> ElasticBlock | None:
    """The elastic block of a body with D^-1 applied to all matrices."""
    if not isinstance(s.mechanics, ReducedMechanics):
        return b.block
    tested = next(t.tested for t in s.mechanics.whole.bodies if t.step.name == b.name)
    if tested is None:
        return None
    return CompressedElastic.of(tested, np.eye(len(tested.mass)), None, c1, c2)


def _frame(b: BodyStep) -> FrameArrays:
    made = b.frame.arrays()
    if made is None:
        raise NotCompiled(f"the frame of body {b.name} is not given as arrays")
    return made


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
        array(np.atleast_2d(block.by_rate)), array(np.atleast_2d(block.by_value)),
        array(loads.base), array(loads.loads), timed.amplitudes(loads.amplitudes),
        timed.tables(loads.tables),
        local_arrays(points_of(block.local, name), active, laws, timed), block.rtol,
        block.max_iterations)


def _forces(
    local: LocalForces | None, name: str, k: int, active: IntArray, laws: list[Called], timed: Timed
) -> tuple[LocalArrays, LocalArrays]:
    """Local terms of k displacements: those that depend on temperatures alone, as functions of
    these, and the others."""
    if local is None:
        return NO_LOCAL, NO_LOCAL
    if not isinstance(local, ReducedLocal):
        raise NotCompiled(f"{name} is of full order")
    still, moving = (points_of(terms, name) for terms in (local.still, local.moving))
    return (local_arrays(still, active[:0], laws, timed, k),
            local_arrays(moving, active, laws, timed))


def _body(
    i: int, b: BodyStep, f: FrameArrays, timed: Timed, laws: list[Called], terms: list[BodyTerms]
) -> BodyArrays:
    """Arrays of body number i, without the index of the body; its local terms are added to
    `terms`."""
    rows, columns = (i.astype(np.int64) for i in np.nonzero(b.to_border))
    gains = np.array([-1 if a is None else timed.amplitudes([a]) for a in f.amplitudes],
                     dtype=np.int64)
    n = b.frame.rigid_size
    made = NO_BODY._replace(
        items=number(len(f.kinds)), kinds=f.kinds.astype(np.int64), numbers=array(f.numbers),
        starts=f.starts.astype(np.int64), gains=gains, entries=number(len(rows)), rows=rows,
        columns=columns, values=array(b.to_border[rows, columns]), origin=array(b.origin),
        guide=number(timed.motion(b.guide, n)), rigid=number(n), positions=number(min(3, n - 1)))
    e = b.block
    if e is None:
        return made
    if not isinstance(e, CompressedElastic):
        raise NotCompiled(f"{b.elastic_name} is of full order")
    k, kt = b.elastic.stop - b.elastic.start, b.thermal.stop - b.thermal.start
    active, idle = _split(b.elastic.start, k, e.active)
    (s, p, g), j = e.sizes, e.H.shape[1] - 3 * k - kt
    u, v, a, rest = np.split(e.H.T, (k, 2 * k, 3 * k))
    H = np.concatenate((u, a, rest, v if v.any() else v[:0]))
    still, local = _forces(e.local, b.elastic_name, k, active - b.elastic.start, laws, timed)
    if len(still.terms) or len(local.terms):
        points = np.zeros((2, len(local.offset)))
        terms.append(BodyTerms(i, still, local, *points))
    return made._replace(
        u=number(b.elastic.start), k=number(k), s=number(s), active=active, idle=idle,
        T=number(b.thermal.start), kt=number(kt), g=number(g), p=number(p),
        inputs=number(len(H)), H=by_four(H), base=array(e.base), j=number(j),
        products=by_four(e.S.T), step_products=by_four(e.S[:, active - b.elastic.start].T),
        E=array(e.EG[:s].T), G=array(e.EG[s:].T), amplitude=number(timed.amplitudes(e.amplitudes)),
        table=number(timed.tables(e.tables)))


@dataclass(frozen=True, slots=True, eq=False)
class _DrivenRows:
    """Functions of time of one body: kappa, mu, the bound of the contraction factor, and loads."""

    body: Driven
    c1: float

    def __call__(self, times: FloatArray) -> FloatArray:
        rows, g = self.body.table.along(times), len(self.body.G)
        weights = np.abs(rows[:, :g] + self.c1 * rows[:, g : 2 * g])
        lead, rest = weights.dot(self.body.sizes).T
        bound = rest + lead * (lead + rest)  # of two products in the leading modes
        return np.hstack((rows[:, : 2 * g], bound[:, None], -rows[:, 2 * g :]))


def _prescribed(
    eq: Reduced, number: int, c1: float, timed: Timed, laws: list[Called]
) -> PrescribedArrays:
    d = eq.driven[number]
    b, name = d.step, d.step.elastic_name
    t = next(body.tested for body in eq.bodies if body.step is b)
    assert t is not None
    k, kt = b.elastic.stop - b.elastic.start, b.thermal.stop - b.thermal.start
    active, idle = _split(b.elastic.start, k, None)
    still, moving = (points_of([p for p in t.local if p.still == of], name)
                     for of in (True, False))
    table, r = TimeTable.of(_DrivenRows(d, c1), np.array(d.table.times)), d.leading
    width = 2 * len(d.G) + 1 + k
    return PrescribedArrays(
        number, b.elastic.start, k, active, idle, b.thermal.start, kt,
        _array(-t.mass), _array(-t.stiffness),
        _array(-t.damping) if t.damping.any() else np.zeros((0, k)),
        array(t.coupling.T), array(d.G),
        array(t.generators[:, :r, :r].reshape(len(d.G) * r, r)), timed.table(table, width), width,
        local_arrays(still, active[:0], laws, timed, k),
        local_arrays(moving, active - b.elastic.start, laws, timed))


def _array(A: FloatArray) -> FloatArray:
    """A matrix, or a diagonal as one row."""
    return array(np.atleast_2d(carried(A)))


def model_arrays(s: Stepper, rules: UpdateRules, h: float) -> ModelArrays:
    """Constants of the model of `s` for steps of h, s, by an integrator with these rules."""
    layout: Layout = s.layout
    bodies = () if s.mechanics is None or not s.mechanics.size else s.mechanics.bodies
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
        array(rules.second.new), array(rules.second.old), array(rules.first.new),
        array(rules.first.old), c1, c2, c1_first, 2.0 * round(h * c1_first - 1.0, 12) / h**2, h,
        layout.frames.stop,
        np.array([*block_starts(layout), layout.size], dtype=np.int64), weights,
        array(s.sanity), s.tolerances.remaining, s.tolerances.max_iterations,
        np.array(layout.quaternions, dtype=np.int64))
