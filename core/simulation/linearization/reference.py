"""Reference of the stability check: the Galerkin model of the same active atoms.

Projection keeps the operators symmetric, so that it adds no growth of its own; what grows there is
the motion itself. Full order would be the same reference at the cost of its mesh.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import (
    Basis,
    Dictionary,
    Integrator,
    ReducedProblem,
    State,
    StepFactors,
    StepSolver,
)
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.defaults import PROJECTION
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, started
from sparsemor.core.status import SolveFailed, Status

STATES = 5
"""States of the run to come that a model is linearised at."""
AHEAD = 4000
"""Most steps of the projected model that are taken to get there."""
MANY = 400
"""Atoms from which the projected model is too dear to be run: the start alone is looked at."""


class _Given(Offline):
    """Offline products that are there already: these dictionaries."""

    def __init__(self, model: Model, dictionaries: Mapping[str, Dictionary]) -> None:
        super().__init__(model, dict, "", Products(None))
        self._given = dictionaries

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        return self._given[name], 0.0


def projected(
    model: Model, integrator: Integrator, h: float, solver: StepSolver,
    supports: Mapping[str, BoolArray], registry: Registry | None = None,
) -> StepSolver:
    """The Galerkin model on the active atoms, made orthonormal: only their span matters.

    Raises SolveFailed where the projected blocks are singular.
    """
    spans = {name: _orthonormal(d, supports.get(name)) for name, d in solver.dictionaries.items()}
    reducer: Any = (registry or Registry()).get("reducer", PROJECTION)()
    try:
        made: StepSolver = reducer.prepare(ReducedProblem(
            model, integrator, h, _Given(model, spans), np.random.default_rng(0)))
    except np.linalg.LinAlgError as error:
        raise SolveFailed(Status.SINGULAR, 0.0, "", f"the projected model: {error}") from None
    return made


def along(
    solver: StepSolver, integrator: Integrator, h: float, start: State, times: Sequence[float],
) -> list[State]:
    """Full-order states of the solver's own run at `times` (s, multiples of h, 0 is the start).

    Raises SolveFailed when the run does not get there.
    """
    due = {round(t / h) for t in times}
    found = {0: start}
    state, memory = started(solver, integrator, start)
    step = FixedStep(integrator, solver, h)
    for n, taken in enumerate(accepted_steps(step, state, memory, max(due), h), 1):
        if n in due:
            found[n] = full_state(solver, taken.state)
    return [found[round(t / h)] for t in times]


def linearization_times(h: float, steps: int) -> tuple[float, ...]:
    """From the start to the end of the run, or as far ahead as is looked."""
    last = min(steps, AHEAD)
    return tuple(h * n for n in sorted({round(i * last / (STATES - 1)) for i in range(STATES)}))


def states_along(
    model: Model, integrator: Integrator, h: float, solver: StepSolver, start: State,
    times: Sequence[float], registry: Registry | None = None,
) -> list[State]:
    """States at `times` of the run of the projected model with the solver's atoms; the start
    alone where that model cannot be made, does not get there, or is as large as full order.

    The start alone, too, for rules of higher order: they damp little, and frames that swing then
    grow in each frozen map without growing in the run (docs/stability.md).
    """
    many = sum(d.atoms.shape[1] for d in solver.dictionaries.values()) > MANY
    if many or integrator.order > 1 or not any(times):
        return [start]
    try:
        twin = projected(model, integrator, h, solver, {}, registry)
        return along(twin, integrator, h, start, times)
    except (SolveFailed, InputError):
        return [start]


def full_state(solver: StepSolver, state: State) -> State:
    """The state in full-order unknowns, without the integrator's memory."""
    x, v, a = [], [], []
    for b in solver.layout:
        at, d = solver.layout[b.name], solver.dictionaries.get(b.name)
        x.append(state.x[at] if d is None else d.offset + d.atoms @ state.x[at])
        v.append(state.v[at] if d is None else d.atoms @ state.v[at])
        a.append(state.a[at] if d is None else d.atoms @ state.a[at])
    whole = np.concatenate(x)
    return State(state.t, whole, np.concatenate(v), np.concatenate(a), np.zeros((len(whole), 0)))


def times_checked(times: Sequence[float], h: float, end: float) -> tuple[float, ...]:
    """Raises InputError (key `at`) for times that are no step of the run."""
    for t in times:
        if not 0.0 <= t <= end * (1 + 1e-9) or abs(round(t / h) * h - t) > 1e-6 * h:
            raise InputError(f"{t:g} s is no time of the run: take multiples of {h:g} s from 0 to "
                             f"{end:g}", "at")
    return tuple(times)


def _orthonormal(d: Dictionary, support: BoolArray | None) -> Dictionary:
    use = slice(0, 1) if support is not None and not support.any() else support
    q = np.linalg.qr(d.atoms if use is None else d.atoms[:, use])[0]
    return Dictionary(q, d.offset, tuple(f"span {i}" for i in range(q.shape[1])))
