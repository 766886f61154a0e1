"""Arrays of a model for compiled steps, made from its step solver."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sparsemor.core import FloatArray, IntArray, UpdateRules
from sparsemor.core.protocols.body_frame import FrameArrays
from sparsemor.core.protocols.load_tables import times_rows
from sparsemor.reducers.linalg.modal_coordinates import compact
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled.compile import ArrayFunction, Functions
from sparsemor.reducers.step.compiled.fill_local_terms import local_arrays
from sparsemor.reducers.step.compiled.model_arrays import (
    EquationArrays,
    HeatArrays,
    ModelArrays,
    OperatorArrays,
    PrescribedArrays,
    StackArrays,
    StepArrays,
    TermArrays,
)
from sparsemor.reducers.step.compiled.time_functions import NotCompiled, Timed
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.local_copies import Coupled
from sparsemor.reducers.step.newton_loop import Loop
from sparsemor.reducers.step.reduced_equations import ConstantOperator, Reduced, Stack
from sparsemor.reducers.step.reduced_mechanics import ReducedMechanics
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.step.time_tables import LoadsInTime, total_load_along

LARGEST = 800
"""Largest number of unknowns of mechanics in compiled steps, which use an explicit inverse."""
PRICE = 100
"""Cost of a new Jacobian with frames, which is not compiled, in compiled iterations."""


Loads: TypeAlias = tuple[IntArray | slice, Callable[[FloatArray, FloatArray], FloatArray]]
"""Rows, and their values (T, k) from times (T,), s, and functions of time (T, q)."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Arrays of a model for compiled steps. heat_groups: names of the thermal blocks `heat`;
    arrays: of the mechanical `equations`; functions: those of frames and laws; timed: functions of
    time; loads: rows and their functions of time, which are subtracted from the residual."""

    heat_groups: tuple[str, ...]
    heat: tuple[HeatArrays, ...]
    arrays: EquationArrays
    functions: Functions
    timed: Timed
    loads: tuple[Loads, ...]
    equations: Reduced

    def base_along(self, times: FloatArray, timed: FloatArray) -> FloatArray:
        """Rows (T, n) that depend on time alone at times (T,), s, with their sign on the left-hand
        side; timed (T, q): functions of time."""
        found = np.zeros((len(times), self.equations.layout.size))
        for rows, load in self.loads:
            found[:, rows] -= load(times, timed)
        return found


def plan(s: BlockwiseSolver) -> Plan:
    """Arrays for the steps of `s`. Raises NotCompiled, with the reason, where its model contains
    what compiled steps do not."""
    mechanics, timed, laws = s.mechanics, Timed(), list[ArrayFunction]()
    if s.full_heat:
        raise NotCompiled("the model has blocks at full order")
    blocks = [_heat_block(s, name) for name, _ in s.heat_groups]
    local = any(block.local for block in blocks)
    heat = tuple(_heat(block, name, np.arange(s.layout.size)[at], local, timed, laws)
                 for block, (name, at) in zip(blocks, s.heat_groups, strict=True))
    if not isinstance(mechanics, ReducedMechanics):
        raise NotCompiled("bodies of full order, or atoms that are selected during the run")
    eq = mechanics.equations
    solved = np.arange(s.layout.size)[eq.solved]
    if len(solved) > LARGEST:
        raise NotCompiled(f"{len(solved)} unknowns of mechanics")
    frames = [[_frame(b.step) for b in stack.bodies] for stack in eq.stacks]
    functions = list({f.function: f for stack in frames for f in stack}.values())
    if len(functions) > 1:
        raise NotCompiled("frames with different functions")
    prescribed = tuple(
        PrescribedArrays(b.at.start, b.G, timed.table(b.table, 2 * len(b.G)),
                         np.zeros(b.G.shape[-1]))
        for b in eq.prescribed_bodies)
    known, iterated = (tuple(_term(s, c, laws, timed) for c in terms)
                       for terms in (eq.known, eq.iterated))
    arrays = EquationArrays(
        tuple(_operator(c) for c in eq.constants if c.of < 2 and c.A.any()),
        tuple(_operator(c, full=True) for c in eq.thermal),
        tuple(_stack(stack, made, eq.border, timed)
              for stack, made in zip(eq.stacks, frames, strict=True)),
        prescribed, known, iterated,
        np.arange(s.layout.size)[eq.identity], solved, bool(eq.bodies),
        PRICE if eq.stacks else eq.price)
    used = {kind for stack in frames for f in stack for kind in f.kinds.tolist()}
    unused = [f for made in functions for i, f in enumerate(made.parts) if i not in used]
    return Plan(tuple(name for name, _ in s.heat_groups), heat, arrays, Functions(
        functions[0].function if functions else None, tuple(laws), tuple(unused)),
        timed, tuple(_loads(s, blocks, eq, timed)), eq)


def _loads(
    s: BlockwiseSolver, blocks: Sequence[CompressedHeat], eq: Reduced, timed: Timed
) -> list[Loads]:
    """Rows that depend on time alone, with their sign on the right-hand side."""
    loads: list[tuple[IntArray | slice, LoadsInTime]] = [
        (at, block.loads) for block, (_, at) in zip(blocks, s.heat_groups, strict=True)]
    for b in eq.bodies:
        if (t := b.operators) is not None and b.factors is None:
            loads.append((b.step.elastic, LoadsInTime(
                -t.constant, t.loads, tuple(t.amplitudes), t.tables)))
    for i, f in eq.targets:
        loads.append((eq.border[[i]], LoadsInTime(np.zeros(1), np.ones((1, 1)), (f,), ())))
    return [*((rows, _along(load, timed)) for rows, load in loads), *(
        (b.rows, lambda times, _, b=b: -b.table.along(times)[:, 2 * len(b.G) :])
        for b in eq.prescribed_bodies)]


def _along(load: LoadsInTime, timed: Timed) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Values of these loads, with their amplitudes among the functions of time `timed`."""
    first, count = timed.amplitudes(load.amplitudes), len(load.amplitudes)

    def values(times: FloatArray, timed: FloatArray) -> FloatArray:
        rows = load.base + times_rows(timed[:, first : first + count], load.loads)
        return rows + total_load_along(load.tables, times) if load.tables else rows

    return values


def _array(values: FloatArray) -> FloatArray:
    """A contiguous matrix that may be written to; a diagonal has one row."""
    return np.array(np.atleast_2d(values), dtype=np.float64, order="C")


def _operator(c: ConstantOperator, full: bool = False) -> OperatorArrays:
    """Arrays of a constant operator; full: never as a diagonal."""
    A = c.A if full else compact(c.A)
    return OperatorArrays(c.rows.start, c.columns.start, c.of, _array(A.T))


def _term(
    s: BlockwiseSolver, c: Coupled, laws: list[ArrayFunction], timed: Timed
) -> TermArrays:
    name = ", ".join(s.layout.containing(c.rows))
    local = local_arrays([c.term], name, laws, timed)
    if (local.reads[:, 2] == 2).any():
        raise NotCompiled(f"{name} has terms with second differences")
    return TermArrays(c.rows, c.columns, local)


def _frame(b: BodyStep) -> FrameArrays:
    made = b.frame.arrays()
    if made is None:
        raise NotCompiled(f"the frame of body {b.name} is not given as arrays")
    return made


def _heat_block(s: BlockwiseSolver, name: str) -> CompressedHeat:
    block = s.heat[name]
    if not isinstance(block, CompressedHeat) or block.active is not None:
        raise NotCompiled(f"{name} is of full order, or its atoms are selected during the run")
    return block


def _heat(
    block: CompressedHeat, name: str, at: IntArray, local: bool, timed: Timed,
    laws: list[ArrayFunction],
) -> HeatArrays:
    """Arrays of the thermal block `name` with the unknowns `at`; its laws and amplitudes are added
    to those of the model; local: True if any block has local terms."""
    n = len(at)
    k = n if block.local else 0
    return HeatArrays(
        at, _array(block.by_rate.T), _array(block.by_value.T),
        (local_arrays(block.local, name, laws, timed),) if local else (),
        block.tolerances.remaining, block.tolerances.max_iterations, np.zeros((k, k)),
        np.zeros(1, dtype=np.int64), *np.zeros((3, n)))


def _stack(
    stack: Stack, frames: Sequence[FrameArrays], border: IntArray, timed: Timed
) -> StackArrays:
    """Arrays of bodies of similar size and their frames, from those of the stack, whose border
    unknowns are the last ones of b."""
    B, b, g, k, p = len(frames), stack.b, stack.g, stack.k, stack.p
    bodies, origin, maps, ends = np.zeros((B, 8), dtype=np.int64), np.zeros((B, b)), [], [0]
    for i, (body, f, n) in enumerate(zip(stack.bodies, frames, stack.sizes, strict=True)):
        step = body.step
        origin[i, : len(step.origin)] = step.origin
        rows, columns = np.nonzero(step.to_border)
        maps.append((rows, border[columns], step.to_border[rows, columns]))
        ends.append(ends[-1] + len(rows))
        bodies[i] = (len(f.kinds), step.elastic.start, n, step.frame.generators if n else 0,
                     timed.motion(step.guide, step.frame.rigid_size), step.frame.rigid_size,
                     ends[i], ends[i + 1])
    items = max(len(f.kinds) for f in frames)
    all_rows, all_columns, values = map(np.concatenate, zip(*maps, strict=True))
    return StackArrays(
        bodies, all_rows, all_columns, values,
        _filled([f.kinds for f in frames]), _filled([f.numbers for f in frames]),
        _filled([f.starts.reshape(-1, 3) for f in frames]), _filled([np.array(
            [-1 if a is None else timed.amplitudes([a]) for a in f.amplitudes], dtype=np.int64)
            for f in frames]),
        origin, stack.P, stack.E,
        np.ascontiguousarray(stack.Q.reshape(B, k, g, k).transpose(0, 3, 2, 1)).reshape(
            B, k, g * k),
        np.ascontiguousarray(stack.G.reshape(B, k, g, k).transpose(0, 2, 1, 3)).reshape(
            B, g * k, k),
        np.zeros((b + 1, p)), np.zeros((b, p)), np.zeros((b, b + 1)), np.zeros(2 * g + 1),
        np.zeros((3, p)), np.zeros(3 * g), np.zeros((3, b)), np.zeros(items), np.zeros(g * k),
        np.zeros((3, 0)), np.zeros(320))


def _filled(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays of all bodies as one, filled up with zeros."""
    sizes = np.array([part.shape for part in parts])
    out = np.zeros((len(parts), *sizes.max(axis=0)), dtype=parts[0].dtype)
    for own, part, size in zip(out, parts, sizes.tolist(), strict=True):
        own[tuple(map(slice, size))] = part
    return out


def model_arrays(s: BlockwiseSolver, rules: UpdateRules, h: float) -> ModelArrays:
    """Constants of the model of `s` for steps of h, s, by an integrator with these rules: unknowns
    with their rates and the integrator's memory, z (q, n), are old z + new d at the end of a step,
    with the departure d (n,) from the free motion (old z)."""
    layout, loop = s.layout, Loop(s.layout, s.tolerances)
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
    weights = np.zeros((s.points + 1, s.points))
    for order in range(1, s.points + 1):
        for j in range(order):
            weights[order, j] = (-1) ** j * comb(order, j + 1)
    return ModelArrays(
        old, new, np.array([first.start, first.stop]), c1, c2, c1_first,
        2.0 * round(h * c1_first - 1.0, 12) / h**2, h, np.append(loop.starts, n), loop.judged,
        loop.second, weights, np.array(s.sanity), s.tolerances.remaining,
        s.tolerances.max_iterations, np.array(layout.quaternions, dtype=np.int64))


def work_of(m: ModelArrays) -> StepArrays:
    """Working arrays of a step."""
    (q, n), blocks = m.new.shape, len(m.judged)
    sizes = ((q, n), (q, n), (3, n), *(5 * [n]), 2 * n, *(5 * [blocks]), (len(m.quaternions), 4, 4))
    return StepArrays(*(np.zeros(size) for size in sizes))
