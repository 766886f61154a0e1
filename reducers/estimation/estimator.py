"""Online estimate of the error of a reduced run: the error equation of each block on a space of its
own.

The full-order run and the reduced run of the same steps differ by e = x_full - x_reduced. In a
block with constant operators e satisfies M e'' + C e' + K e = -r(t), where r is the residual of the
reduced states in the full-order equations, and e satisfies the formulas of the integrator like
each of the runs. Projected on a space of errors (error_space.py) and written in its eigenmodes, one
step costs as much as the residual, which is a product of small matrices. Errors of temperatures act
on displacements as thermal loads; the reaction of rigid coordinates and joint forces to elastic
errors is neglected. Bounds of the same equation from norms (Ruiner, Fehr, Haasdonk and Eberhard
2012, doi 10.1007/s10409-012-0114-7) are rigorous, but add up what cancels over the steps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Integrator, Layout, Note, State, UpdateRule
from sparsemor.reducers.estimation.error_space import ErrorSpace
from sparsemor.reducers.estimation.modal_steps import ModalSteps, begins
from sparsemor.reducers.estimation.reduced_states import StateMap, ranges
from sparsemor.reducers.estimation.residuals import ElasticResidual, HeatResidual, Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class BlockErrors:
    """Error equation of one block. atoms (n, k) and offset (n,): its trial basis; full, reduced:
    its unknowns in the full model and in the reduced one; states: map of its coefficients to the
    coordinates that residuals are evaluated in; warmth (qT, q): loads of the modes by errors of the
    body's temperatures, whose block is `heat` ("" without); None where these do not act."""

    name: str
    space: ErrorSpace
    residual: HeatResidual | ElasticResidual
    atoms: FloatArray
    offset: FloatArray
    full: slice
    reduced: slice
    states: StateMap
    heat: str = ""
    warmth: FloatArray | None = None

    def starts(self, full: State, reduced: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Modal error (q,) of the initial state, and its first and second rates."""
        c, v, a = (z[self.reduced] for z in (reduced.x, reduced.v, reduced.a))
        x = full.x[self.full] - self.offset - self.atoms @ c
        rate, second = full.v[self.full] - self.atoms @ v, full.a[self.full] - self.atoms @ a
        on = self.space.coefficients
        return on(x), on(rate), on(second)


@dataclass(frozen=True, slots=True, eq=False)
class BlockSteps:
    """Steps of the modes of all thermal and of all elastic blocks."""

    first: ModalSteps
    second: ModalSteps


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """Estimator of errors (`ErrorEstimator`). heat, elastic: blocks of first and second order;
    layout: their modes; reduced: layout of the reduced model; coordinates: that of its states in
    the coordinates that residuals are evaluated in; every: steps between two estimates, the only
    ones at which residuals are evaluated; first: number of first steps with an estimate
    each (`begins`); margin: factor of the estimates; single, whole: one
    step and `every` steps of the modes by the run's integrator, under residuals that are
    interpolated linearly, so that errors vibrate as in the run.

    Memory of a run: "first", "second": modal errors [x, x', x'', history] (s, q) of the blocks of
    each order; "residuals" (q,): of all blocks at the last estimate, in the order of `layout`;
    "outside" (3, m): parts of the last state outside of the error spaces."""

    every: int
    first: int
    margin: float
    heat: tuple[BlockErrors, ...]
    elastic: tuple[BlockErrors, ...]
    layout: Layout
    reduced: Layout
    coordinates: Layout
    integrator: Integrator
    single: BlockSteps
    whole: BlockSteps
    notes: tuple[Note, ...]

    @classmethod
    def of(
        cls, every: int, first: int, margin: float, h: float, heat: Sequence[BlockErrors],
        elastic: Sequence[BlockErrors], full: Layout, reduced: Layout, coordinates: Layout,
        integrator: Integrator, notes: Sequence[Note],
    ) -> "ErrorModel":
        """Error model for every `every`-th step of size h, s; first: number of first steps with an
        estimate each; margin: factor of the estimates; full, reduced: layouts of the full model and
        of the reduced one; coordinates: layout of reduced states in the coordinates that residuals
        are evaluated in."""
        layout = Layout([full.block(b.name).resized(b.space.size) for b in (*heat, *elastic)])
        rules = integrator.rules(h)
        single, whole = (
            BlockSteps(_steps_of(rules.first, n, heat), _steps_of(rules.second, n, elastic))
            for n in (1, every))
        return cls(every, first, margin, tuple(heat), tuple(elastic), layout, reduced, coordinates,
                   integrator, single, whole, notes=tuple(notes))

    @property
    def blocks(self) -> tuple[str, ...]:
        return tuple(b.name for b in (*self.elastic, *self.heat))

    def due(self, step: int) -> bool:
        return step % self.every == 0 or begins(step, self.every, self.first)

    def start(self, full: State, reduced: State) -> dict[str, FloatArray]:
        """Memory of the estimate at the start of a run: modal errors (s, q) of the initial state
        with their rates and the integrator's history, of first and of second order; "residuals":
        those (q,) of the modes at the reduced state; "outside": parts (3, m) of x, v, a of the
        reduced state outside of the error spaces."""
        z = np.zeros((3, self.layout.size))
        for b in (*self.heat, *self.elastic):
            z[:, self.layout[b.name]] = b.starts(full, reduced)
        x, v, a = z
        error = State(full.t, x, v, a, np.zeros((self.layout.size, 0)))
        state = self.integrator.start(self.layout, error)
        rows = np.vstack([state.x, state.v, state.a, state.memory.T])
        at, outside = self._projected(Trajectory(
            np.array([reduced.t]), reduced.x[None], reduced.v[None], reduced.a[None]))
        return {"first": rows[:, self.layout.first], "second": rows[:, self.layout.second],
                "residuals": self._residuals(at)[0], "outside": outside[:, -1]}

    def corrected(self, full: State, memory: Mapping[str, FloatArray]) -> State:
        """A state of the full model plus the estimated errors and their rates."""
        x, v, a = full.x.copy(), full.v.copy(), full.a.copy()
        for blocks, z in ((self.heat, memory["first"]), (self.elastic, memory["second"])):
            for b, at in modes_of(blocks):
                for part, values in zip((x, v, a), z[:3, at], strict=True):
                    part[b.full] += b.space.modes @ values
        for b, at in self._outside:
            for part, values in zip((x, v, a), memory["outside"][:, at], strict=True):
                part[b.full] -= values
        return State(full.t, x, v, a, full.memory)

    def present(self, memory: Mapping[str, FloatArray]) -> dict[str, float]:
        """Estimated error norm of each block at present."""
        found = {b.name: float(np.linalg.norm(b.space.norm @ z[0, at]))
                 for blocks, z in ((self.heat, memory["first"]), (self.elastic, memory["second"]))
                 for b, at in modes_of(blocks)}
        for b, at in self._outside:
            rest = float(np.linalg.norm(memory["outside"][0, at]))
            found[b.name] = float(np.hypot(found[b.name], rest))
        return {n: self.margin * norm for n, norm in found.items()}

    def advance(
        self, paths: Sequence[Sequence[State]], memory: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Estimated error norms (j,) of each block at the ends of j successive paths of `every`
        states of the run, or fewer; `memory` is brought to the last. Only the ends are read."""
        if not paths:
            return {name: np.zeros(0) for name in self.blocks}
        states, counts = [path[-1] for path in paths], [len(path) for path in paths]
        at, outside = self._projected(Trajectory(np.array([s.t for s in states]), *(
            np.stack([getattr(s, which) for s in states]) for which in "xva")))
        return self._advanced(self._residuals(at), outside, counts, memory)

    def carry(self, count: int, memory: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """The same for `count` estimates along full-order steps, to which no error is added."""
        memory["residuals"] = np.zeros(self.layout.size)
        return self._advanced(
            np.zeros((count, self.layout.size)),
            np.repeat(memory["outside"][:, None], count, axis=1), [self.every] * count, memory)

    def _residuals(self, run: Trajectory) -> FloatArray:
        """Residuals (j, q) of all blocks at j states, in the order of `layout`."""
        found = np.zeros((len(run.times), self.layout.size))
        for b in (*self.heat, *self.elastic):
            found[:, self.layout[b.name]] = b.residual(run)
        return found

    def _advanced(
        self, residuals: FloatArray, outside: FloatArray, counts: Sequence[int],
        memory: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Error norms (j,) of each block at j estimates with residuals (j, q), so many steps
        (`counts`) after each other, brought to `memory`. Parts (3, j, m) of states outside of the
        error space (reduced_states.py) are errors as they are. single, whole: one step of the modes
        and `every` at once, under residuals that change linearly meanwhile."""
        known: dict[str, list[FloatArray]] = {b.name: [] for b in (*self.heat, *self.elastic)}
        for r, count in zip(residuals, counts, strict=True):
            if count == self.every:
                self._step(self.whole, r, memory)
            else:  # step by step
                for part in np.linspace(memory["residuals"], r, count + 1)[1:]:
                    self._step(self.single, part, memory)
            for blocks, which in ((self.heat, "first"), (self.elastic, "second")):
                for b, at in modes_of(blocks):
                    known[b.name].append(memory[which][0, at])
        found = {b.name: np.linalg.norm(
            np.reshape(known[b.name], (-1, b.space.size)) @ b.space.norm.T, axis=1)
            for b in (*self.heat, *self.elastic)}
        for b, at in self._outside:
            found[b.name] = np.hypot(found[b.name], np.linalg.norm(outside[0][:, at], axis=1))
        if counts:
            memory["outside"] = outside[:, -1]
        return {n: self.margin * norms for n, norms in found.items()}

    def _step(
        self, steps: BlockSteps, residual: FloatArray, memory: dict[str, FloatArray]
    ) -> None:
        """Brings the errors in `memory` by these steps to where the residual of all blocks is
        `residual` (q,): first those of heat, which load displacements."""
        first, second = self.layout.first, self.layout.second
        before = self._loads(memory["residuals"], memory["first"])
        memory["first"] = steps.first.advance(memory["first"], before[first], -residual[first])
        after = self._loads(residual, memory["first"])
        memory["second"] = steps.second.advance(memory["second"], before[second], after[second])
        memory["residuals"] = residual

    def _loads(self, residual: FloatArray, heat: FloatArray) -> FloatArray:
        """Loads (q,) of the error equations: minus the residual (q,), and those of the errors of
        temperatures with modal errors `heat` (s, qT)."""
        loads, start = -residual, self.layout.first.start
        for b in self.elastic:
            if b.warmth is not None:
                at = self.layout[b.heat]
                loads[self.layout[b.name]] += heat[0, at.start - start : at.stop - start] @ b.warmth
        return loads

    @property
    def _outside(self) -> list[tuple[BlockErrors, slice]]:
        """Blocks with reduced states outside of their error space, with their ranges."""
        blocks = {b.name: b for b in (*self.heat, *self.elastic) if b.states.outside}
        found = ranges({n: b.states.outside for n, b in blocks.items()})
        return [(blocks[n], at) for n, at in found.items()]

    def _projected(self, run: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Reduced states in the coordinates of the residuals (layout `coordinates`, from that of
        the `reduced` model), and the parts (3, j, m) of x, v and a outside of the error spaces.
        Where all spaces contain the atoms, the coordinates are the reduced unknowns themselves."""
        maps = {b.name: b for b in (*self.heat, *self.elastic)}
        count = len(run.times)
        if not self._outside:
            return run, np.zeros((3, count, 0))
        wide = np.zeros((3, count, self.coordinates.size))  # x, v, a at each time
        outside = {b.name: np.zeros((3, count, 0)) for b, _ in self._outside}
        for block in self.coordinates:
            b = maps.get(block.name)
            C = np.vstack([part[:, self.reduced[block.name]] for part in (run.x, run.v, run.a)])
            if b is not None:
                C, rest = b.states(C)
                if b.name in outside:
                    outside[b.name] = rest.reshape(3, count, -1)
            wide[:, :, self.coordinates[block.name]] = C.reshape(3, count, -1)
        return Trajectory(run.times, *wide), np.concatenate(list(outside.values()), axis=2)


def _steps_of(rule: UpdateRule, count: int, blocks: Sequence[BlockErrors]) -> ModalSteps:
    """`count` steps of the modes of several blocks of one order, one block after the other."""
    none, spaces = np.zeros(0), [b.space for b in blocks]
    return ModalSteps.from_rule(
        rule, count, stiffness=np.concatenate([none, *(s.stiffness for s in spaces)]),
        damping=np.concatenate([none, *(s.damping for s in spaces)]),
        mass=np.concatenate([none, *(s.mass for s in spaces)]))


def modes_of(blocks: Sequence[BlockErrors]) -> list[tuple[BlockErrors, slice]]:
    """Blocks of one order with the ranges of their modes."""
    ends = np.cumsum([0, *(b.space.size for b in blocks)]).tolist()
    return [(b, slice(i, j)) for b, i, j in zip(blocks, ends[:-1], ends[1:], strict=True)]
