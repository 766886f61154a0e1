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
from sparsemor.reducers.estimation.modal_steps import (
    ModalSteps,
    error_rules,
    error_start,
)
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

    def force(
        self, run: Trajectory | int, errors: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Loads (j, q) of the error equation at j states: minus the residual, which is 0 at j
        states of full order, and those of the errors (j, qT) of temperatures."""
        f = np.zeros((run, self.space.size)) if isinstance(run, int) else -self.residual(run)
        return f if self.warmth is None else f + errors[self.heat] @ self.warmth


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """Estimator of errors (`ErrorEstimator`). heat, elastic: blocks of first and second order;
    layout: their modes; reduced: layout of the reduced model; coordinates: that of its states in
    the coordinates that residuals are evaluated in; every: steps between two estimates, over which
    the error equation takes one step (`error_rules`); margin: factor of the estimates; first,
    second: steps of the modes of all thermal and of all elastic blocks.

    Memory of a run: "first", "second": modal errors [x, x', x'', history] (s, q) of the blocks of
    each order; "outside" (3, m): parts of the last state outside of the error spaces."""

    every: int
    margin: float
    heat: tuple[BlockErrors, ...]
    elastic: tuple[BlockErrors, ...]
    layout: Layout
    reduced: Layout
    coordinates: Layout
    integrator: Integrator
    first: ModalSteps
    second: ModalSteps
    notes: tuple[Note, ...]

    @classmethod
    def of(
        cls, every: int, margin: float, h: float, heat: Sequence[BlockErrors],
        elastic: Sequence[BlockErrors], full: Layout, reduced: Layout, coordinates: Layout,
        integrator: Integrator, notes: Sequence[Note],
    ) -> "ErrorModel":
        """Error model for every `every`-th step of size h, s; margin: factor of the estimates;
        full, reduced: layouts of the full model and of the reduced one; coordinates: layout of
        reduced states in the coordinates that residuals are evaluated in."""
        layout = Layout([full.block(b.name).resized(b.space.size) for b in (*heat, *elastic)])
        rules = error_rules(integrator, every, h)
        return cls(every, margin, tuple(heat), tuple(elastic), layout, reduced, coordinates,
                   integrator, first=_steps_of(rules.first, heat),
                   second=_steps_of(rules.second, elastic), notes=tuple(notes))

    @property
    def blocks(self) -> tuple[str, ...]:
        return tuple(b.name for b in (*self.elastic, *self.heat))

    def start(self, full: State, reduced: State) -> dict[str, FloatArray]:
        """Memory of the estimate at the start of a run: modal errors (s, q) of the initial state
        with their rates and the integrator's history, of first and of second order; "outside":
        parts (3, m) of x, v, a of the reduced state outside of the error spaces."""
        z = np.zeros((3, self.layout.size))
        for b in (*self.heat, *self.elastic):
            z[:, self.layout[b.name]] = b.starts(full, reduced)
        x, v, a = z
        error = State(full.t, x, v, a, np.zeros((self.layout.size, 0)))
        state = error_start(self.integrator, self.every, self.layout, error)
        rows = np.vstack([state.x, state.v, state.a, state.memory.T])
        at = Trajectory(np.array([reduced.t]), reduced.x[None], reduced.v[None], reduced.a[None])
        return {"first": rows[:, self.layout.first], "second": rows[:, self.layout.second],
                "outside": self._projected(at)[1][:, -1]}

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
        states of the run; `memory` is brought to the last. Only the ends are read."""
        if not paths:
            return {name: np.zeros(0) for name in self.blocks}
        states = [path[-1] for path in paths]
        run = Trajectory(np.array([s.t for s in states]), *(
            np.stack([getattr(s, which) for s in states]) for which in "xva"))
        return self._advanced(run, len(states), memory)

    def carry(self, count: int, memory: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """The same for `count` estimates along full-order steps, to which no error is added."""
        return self._advanced(count, count, memory)

    def _advanced(
        self, run: Trajectory | int, count: int, memory: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Error norms (count,) of each block after as many estimates along reduced states, or along
        full-order steps if `run` is their number, brought to `memory`; errors of heat first, which
        load displacements. Parts of states outside of the error space (reduced_states.py) are
        errors as they are."""
        found: dict[str, FloatArray] = {}
        modal: dict[str, FloatArray] = {}  # block -> errors of its modes (count, q)
        if isinstance(run, int):
            outside = np.repeat(memory["outside"][:, None], count, axis=1)
        else:
            run, outside = self._projected(run)
        for blocks, which, steps in ((self.heat, "first", self.first),
                                     (self.elastic, "second", self.second)):
            loads = [np.zeros((count, 0)), *(b.force(run, modal) for b in blocks)]
            memory[which], x = steps.advance(memory[which], np.hstack(loads))
            for b, at in modes_of(blocks):
                modal[b.name] = x[:, at]
                found[b.name] = np.linalg.norm(x[:, at] @ b.space.norm.T, axis=1)
        for b, at in self._outside:
            found[b.name] = np.hypot(found[b.name], np.linalg.norm(outside[0][:, at], axis=1))
        if count:
            memory["outside"] = outside[:, -1]
        return {n: self.margin * norms for n, norms in found.items()}

    @property
    def _outside(self) -> list[tuple[BlockErrors, slice]]:
        """Blocks with reduced states outside of their error space, with their ranges."""
        blocks = {b.name: b for b in (*self.heat, *self.elastic) if b.states.outside}
        found = ranges({n: b.states.outside for n, b in blocks.items()})
        return [(blocks[n], at) for n, at in found.items()]

    def _projected(self, run: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Reduced states in the coordinates of the residuals (layout `coordinates`, from that of
        the `reduced` model), and the parts (3, j, m) of x, v and a outside of the error spaces."""
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


def _steps_of(rule: UpdateRule, blocks: Sequence[BlockErrors]) -> ModalSteps:
    """Steps of the modes of several blocks of one order, one block after the other."""
    none, spaces = np.zeros(0), [b.space for b in blocks]
    return ModalSteps.from_rule(
        rule, stiffness=np.concatenate([none, *(s.stiffness for s in spaces)]),
        damping=np.concatenate([none, *(s.damping for s in spaces)]),
        mass=np.concatenate([none, *(s.mass for s in spaces)]))


def modes_of(blocks: Sequence[BlockErrors]) -> list[tuple[BlockErrors, slice]]:
    """Blocks of one order with the ranges of their modes."""
    ends = np.cumsum([0, *(b.space.size for b in blocks)]).tolist()
    return [(b, slice(i, j)) for b, i, j in zip(blocks, ends[:-1], ends[1:], strict=True)]
