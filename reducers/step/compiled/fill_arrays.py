"""Arrays of a model for compiled steps, made from its step solver."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any, NamedTuple

import numpy as np

from sparsemor.core import FloatArray, IntArray, UpdateRules
from sparsemor.core.protocols.body_frame import FrameArrays
from sparsemor.reducers.linalg.modal_coordinates import compact
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled.compile import ArrayFunction, Functions
from sparsemor.reducers.step.compiled.fill_local_terms import local_arrays
from sparsemor.reducers.step.compiled.model_arrays import (
    BodyArrays,
    BodyWork,
    HeatArrays,
    ModelArrays,
    PrescribedArrays,
    StepArrays,
    TermArrays,
)
from sparsemor.reducers.step.compiled.time_functions import NotCompiled, Timed
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.newton_loop import Loop
from sparsemor.reducers.step.prescribed_body import PrescribedBody
from sparsemor.reducers.step.reduced_equations import BodyRows, Reduced
from sparsemor.reducers.step.reduced_mechanics import ReducedMechanics
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.step.time_tables import Moving, TimeTable, total_load_along

LARGEST = 800
"""Largest number of unknowns of mechanics in compiled steps, which use an explicit inverse."""


class LoadRows(NamedTuple):
    """Rows `at` of a residual that depend on time alone: - base - loads amplitudes - tables;
    amplitude: number of the first amplitude."""

    at: IntArray
    base: FloatArray
    loads: FloatArray
    amplitude: int
    tables: Sequence[Moving]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Arrays of a model for compiled steps. heat_groups: names of the thermal blocks `heat`;
    bodies, terms: of all bodies with unknown motion; prescribed: each with prescribed motion;
    functions: those of frames and laws; timed: functions of time; loads: rows that depend on these
    alone; equations: of the bodies with unknown motion, None where there are none."""

    heat_groups: tuple[str, ...]
    heat: tuple[HeatArrays, ...]
    bodies: BodyArrays
    terms: tuple[TermArrays, ...]
    prescribed: tuple[PrescribedArrays, ...]
    functions: Functions
    timed: Timed
    loads: tuple[LoadRows, ...]
    equations: Reduced | None

    def base_along(self, times: FloatArray, timed: FloatArray, n: int) -> FloatArray:
        """Rows (T, n) that depend on time alone at times (T,), s, with their sign on the left-hand
        side: minus base, loads times amplitudes, and tables of each part; timed (T, q): functions
        of time. The sums of a time are the same whichever the others are."""
        found = np.zeros((len(times), n))
        for part in self.loads:
            rows = np.zeros((len(times), len(part.at))) + part.base
            for j, load in enumerate(part.loads.T):
                rows += np.multiply.outer(timed[:, part.amplitude + j], load)
            if part.tables:
                rows += total_load_along(part.tables, times)
            found[:, part.at] -= rows
        return found


def plan(s: BlockwiseSolver, c1: float = 1.0) -> Plan:
    """Arrays for the steps of `s` with this factor of rates. Raises NotCompiled, with the reason,
    where its model contains what compiled steps do not."""
    mechanics, timed, laws, loads = s.mechanics, Timed(), list[ArrayFunction](), list[LoadRows]()
    if s.full_heat:
        raise NotCompiled("the model has blocks at full order")
    heat_groups = tuple(name for name, _ in s.heat_groups)
    heat = tuple(_heat(s, where, name, timed, laws, loads) for name, where in s.heat_groups)
    if not isinstance(mechanics, ReducedMechanics):
        raise NotCompiled("bodies of full order, or atoms that are selected during the run")
    eq = mechanics.equations
    if not len(eq.border):
        prescribed = tuple(_prescribed(s, eq, b, c1, timed, laws) for b in eq.prescribed_bodies)
        return Plan(heat_groups, heat, stacked(()), (), prescribed, Functions(
            None, tuple(laws), bool(prescribed)),
                    timed, tuple(loads), None)
    if (count := np.arange(s.layout.size)[eq.solved].size) > LARGEST:
        raise NotCompiled(f"{count} unknowns of mechanics")
    frames = [_frame(b.step) for b in eq.bodies]
    if len({f.function for f in frames}) > 1:
        raise NotCompiled("frames with different functions")
    terms = []
    for c in eq.coupled:
        name = ", ".join(s.layout.containing(c.rows))
        local = local_arrays([c.term], name, laws, timed)
        if (local.reads[:, 2] == 2).any():
            raise NotCompiled(f"{name} has terms with second differences")
        terms.append(TermArrays(c in eq.known, c.rows, c.columns, local))
    bodies = [_body(b, f, eq.border, timed) for b, f in zip(eq.bodies, frames, strict=True)]
    for b in eq.bodies:
        if (t := b.operators) is not None:  # rows are - base - loads, with `constant` on the left
            loads.append(LoadRows(_range(b.step.elastic), -t.constant, t.loads,
                               timed.amplitudes(t.amplitudes), t.tables))
    loads += [LoadRows(eq.border[[i]], np.zeros(1), np.ones((1, 1)), timed.amplitudes([f]), ())
              for i, f in eq.targets]
    used = np.unique(np.concatenate([f.kinds for f in frames])).tolist()
    unused = tuple(f for i, f in enumerate(frames[0].parts) if i not in used)
    return Plan(heat_groups, heat, stacked(bodies), tuple(terms), (), Functions(
        frames[0].function, tuple(laws), False, bool(terms), unused),
        timed, tuple(loads), eq)


def _range(at: slice) -> IntArray:
    return np.arange(at.start, at.stop)


def _array(values: FloatArray) -> FloatArray:
    """A contiguous matrix that may be written to; a diagonal has one row."""
    return np.array(np.atleast_2d(values), dtype=np.float64, order="C")


def _frame(b: BodyStep) -> FrameArrays:
    made = b.frame.arrays()
    if made is None:
        raise NotCompiled(f"the frame of body {b.name} is not given as arrays")
    return made


def _heat(
    s: BlockwiseSolver, where: slice | IntArray, name: str, timed: Timed, laws: list[ArrayFunction],
    loads: list[LoadRows]
) -> HeatArrays:
    """Arrays of the thermal block `name` with the unknowns `where`; its laws, amplitudes and loads
    are added to those of the model. Raises NotCompiled."""
    block, at = s.heat[name], _range(where) if isinstance(where, slice) else where
    if not isinstance(block, CompressedHeat) or block.active is not None:
        raise NotCompiled(f"{name} is of full order, or its atoms are selected during the run")
    loads.append(LoadRows(at, block.loads.base, block.loads.loads,
                       timed.amplitudes(block.loads.amplitudes), block.loads.tables))
    local = local_arrays(block.local, name, laws, timed)
    k = len(at) if block.local else 0
    return HeatArrays(at.astype(np.int64), _array(block.by_rate), _array(block.by_value), local,
                      block.tolerances.remaining, block.tolerances.max_iterations,
                      np.zeros((k, k)), np.zeros(1, np.int64))


def _body(b: BodyRows, f: FrameArrays, border: IntArray, timed: Timed) -> BodyArrays:
    """Arrays of a body (`BodyArrays`), without the index of the body, from its projected operators
    (b.operators) and its frame f as arrays. border: positions of rigid coordinates and joint forces
    in the model; timed: functions of time, to which those of the body are added."""
    step, t, k, g, p = b.step, b.operators, 0, 0, b.step.frame.p
    rows, columns = np.nonzero(step.to_border)
    P, E, Q, G = np.zeros((0, p)), np.zeros((p, 0)), np.zeros((0, 0)), np.zeros((0, 0))
    if t is not None:
        k, g = t.mass.shape[1], len(t.generators)
        P, E = t.functional.T, t.directions.T
        G = t.generators.transpose(0, 2, 1).reshape(g * k, k)
        Q = np.zeros((k, g * k))
        if len(t.quadratic):
            Q = t.quadratic.transpose(1, 0, 2).reshape(k, g * k)
    gains = [-1 if a is None else timed.amplitudes([a]) for a in f.amplitudes]
    n = step.frame.rigid_size
    numbers = {
        "items": len(f.kinds), "kinds": f.kinds, "starts": f.starts.reshape(-1, 3), "gains": gains,
        "entries": len(rows), "rows": rows, "columns": border[columns],
        "guide": timed.motion(step.guide, n), "rigid": n, "e": step.elastic.start, "k": k, "g": g}
    values = {"numbers": f.numbers, "values": step.to_border[rows, columns], "origin": step.origin,
              "P": P, "E": E, "Q": _by_four(Q), "G": _by_four(G)}
    made: dict[str, Any] = {name: np.array(v, dtype=np.int64) for name, v in numbers.items()}
    made |= {name: np.array(v, dtype=np.float64) for name, v in values.items()}
    return BodyArrays(**made)


def _by_four(A: FloatArray) -> FloatArray:
    """A with rows of zeros up to a number that is a multiple of 4."""
    return np.pad(A, ((0, -len(A) % 4), (0, 0)))


_INT, _FLOAT = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
_ONE: IntArray = np.array(0, dtype=np.int64)
NO_BODY = BodyArrays(
    items=_ONE, kinds=_INT, numbers=_FLOAT, starts=np.zeros((0, 3), dtype=np.int64), gains=_INT,
    entries=_ONE, rows=_INT, columns=_INT, values=np.zeros(0), origin=np.zeros(0), guide=_ONE,
    rigid=_ONE, e=_ONE, k=_ONE, g=_ONE, P=_FLOAT, E=_FLOAT, Q=_FLOAT, G=_FLOAT)
"""A body without anything."""


def stacked(bodies: Sequence[BodyArrays]) -> BodyArrays:
    """Arrays of all bodies from those of each."""
    made = []
    for values in zip(*(bodies or (NO_BODY,)), strict=True):
        sizes = np.array([v.shape for v in values], dtype=np.int64)
        out = np.zeros((len(values), *sizes.max(axis=0)), dtype=values[0].dtype)
        for i, v in enumerate(values):
            at: tuple[Any, ...] = (i, *map(slice, v.shape))
            out[at] = v
        made.append(out[: len(bodies)])
    return BodyArrays(*made)


def body_work(b: BodyArrays) -> BodyWork:
    """Working arrays for these bodies."""
    (count, n), p, g = b.origin.shape, b.P.shape[2], int(b.g.max(initial=0))
    sizes: dict[str, tuple[int, ...]] = {
        "sigma": (n + 1, p), "tau": (n, p), "H": (n, n + 1), "coefficients": (2 * g + 1,),
        "s": (3, p), "forms": (3 * g,), "y": (3, n), "gains": (b.kinds.shape[1],),
        "back": (b.G.shape[1] + 4,), "turned": (b.G.shape[1] + 4,)}
    return BodyWork(**{name: np.zeros((count, *shape)) for name, shape in sizes.items()},
                    nothing=np.zeros((3, 0)), sums=np.zeros(320))


@dataclass(frozen=True, slots=True, eq=False)
class _PrescribedRows:
    """Functions of time of one body, (T, 2 g + 1 + k): kappa, mu, the bound of the contraction
    factor, and loads, which are minus the base of its rows. weights (T, g): |kappa + c1 mu|; sizes
    (g, 2): norms of each matrix G_g in the leading modes, and of the rest."""

    body: PrescribedBody
    c1: float

    def __call__(self, times: FloatArray) -> FloatArray:
        rows, g = self.body.table.along(times), len(self.body.G)
        weights = np.abs(rows[:, :g] + self.c1 * rows[:, g : 2 * g])
        lead, rest = weights.dot(self.body.sizes).T
        bound = rest + lead * (lead + rest)  # of two products in the leading modes
        return np.hstack((rows[:, : 2 * g], bound[:, None], -rows[:, 2 * g :]))


def _prescribed(
    s: BlockwiseSolver, eq: Reduced, d: PrescribedBody, c1: float, timed: Timed,
    laws: list[ArrayFunction],
) -> PrescribedArrays:
    """Arrays of a body with prescribed motion, whose operators enter with their sign on the right
    side: d = -(...)."""
    b, name, r, g = d.step, d.step.elastic_name, d.leading, len(d.G)
    t = next(body.operators for body in eq.bodies if body.step is b)
    assert t is not None
    k, kt = b.elastic.stop - b.elastic.start, b.thermal.stop - b.thermal.start
    table, width = TimeTable.tabulate(
        _PrescribedRows(d, c1), np.array(d.table.times)), 2 * g + 1 + k
    return PrescribedArrays(
        [block.name for block in s.layout].index(name), b.elastic.start, k, b.thermal.start, kt,
        _array(-compact(t.mass)), _array(-compact(t.stiffness)),
        _array(-compact(t.damping)) if t.damping.any() else np.zeros((0, k)),
        _array(t.coupling.T), np.array(d.G), _array(t.generators[:, :r, :r].reshape(g * r, r)),
        timed.table(table, width), width,
        local_arrays([p for p in t.local if p.of_temperature], name, laws, timed, k),
        local_arrays([p for p in t.local if not p.of_temperature], name, laws, timed))


def model_arrays(s: BlockwiseSolver, p: Plan, rules: UpdateRules, h: float) -> ModelArrays:
    """Constants of the model of `s` for steps of h, s, by an integrator with these rules: unknowns
    with their rates and the integrator's memory, z (q, n), are old z + new d at the end of a step,
    with the departure d (n,) from the free motion (old z)."""
    layout, eq, loop = s.layout, p.equations, Loop(s.layout, s.tolerances)
    n, q, first = layout.size, len(rules.second.new), layout.first
    c1, c2, c1_first = rules.factors
    old, new = np.zeros((q, q, n)), np.zeros((q, n))
    # x = free + d, v = free_rate + c1 d, a = c2 d, and memory by the highest rate, rates[-1] d
    for at, rule, rates in ((layout.second, rules.second, (1.0, c1, c2)),
                            (first, rules.first, (1.0, c1_first))):
        old[:, :, at] = rule.old[:, :, None]
        old[len(rates) - 1, :, at] = 0.0
        new[:, at] = (rule.new * rates[-1])[:, None]
        new[: len(rates), at] = np.array(rates)[:, None]
    new[0] = 1.0
    whole, atoms = np.zeros((3, 0, 0)), slice(0, 0)
    if eq is not None:
        atoms, a = eq.atoms, eq.atoms.stop - eq.atoms.start
        whole = np.zeros((3, a, a))
        of_rates = [(c, c.of) for c in eq.constants if c.of < 2]
        for c, of in (*of_rates, *((c, 2) for c in eq.thermal)):
            rows, columns = (slice(at.start - atoms.start, at.stop - atoms.start)
                             for at in (c.rows, c.columns))
            whole[of, rows, columns] += c.A
    some = whole != 0.0  # ends: first and last column of each row that are not zero
    some_at_all = some.any(axis=2)
    ends = np.stack((np.where(some_at_all, some.argmax(axis=2), 0), np.where(
        some_at_all, some.shape[2] - some[:, :, ::-1].argmax(axis=2), 0)), axis=2) if (
            whole.size) else np.zeros((3, 0, 2), dtype=np.int64)
    weights = np.zeros((s.points + 1, s.points))
    for order in range(1, s.points + 1):
        for j in range(order):
            weights[order, j] = (-1) ** j * comb(order, j + 1)
    solved = np.arange(n)[eq.solved if eq is not None else slice(0, 0)]
    return ModelArrays(
        old, new, np.array([first.start, first.stop]), np.array([atoms.start, atoms.stop]), whole,
        ends.astype(np.int64), c1, c2, c1_first, 2.0 * round(h * c1_first - 1.0, 12) / h**2, h,
        np.append(loop.starts, n), loop.judged, loop.second, solved, weights, np.array(s.sanity),
        s.tolerances.remaining, s.tolerances.max_iterations,
        np.array(layout.quaternions, dtype=np.int64))


def work_of(m: ModelArrays) -> StepArrays:
    """Working arrays of a step."""
    (q, n), blocks = m.new.shape, len(m.judged)
    sizes = ((q, n), (q, n), (3, n + 4), *(5 * [n]), 2 * n, *(5 * [blocks]),
             (len(m.quaternions), 4, 4))
    return StepArrays(*(np.zeros(size) for size in sizes))
