"""Reference of the stability check: the Galerkin model of the same active atoms.

Projection keeps the operators symmetric, so that it adds no growth of its own: any growth of the
Galerkin model belongs to the motion. The full-order model would be an equivalent reference at a
higher cost.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sparsemor.core import (
    Basis,
    Dictionary,
    Integrator,
    ReducedProblem,
    State,
    StepFactors,
    StepSolver,
)
from sparsemor.core.arrays import BoolArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.model import Model
from sparsemor.core.registry.registry import Registry
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, full_state, started
from sparsemor.core.simulation.training import state_steps
from sparsemor.core.status import SolveFailed, Status

PROJECTION = "galerkin"
"""Reducer by Galerkin projection."""
COARSE = 400
"""Number of steps from which on a run of the Galerkin model takes longer ones."""
MANY = 400
"""Number of atoms above which the Galerkin model is too expensive to run: only the initial state is
linearised."""


class _Given(Offline):
    """Offline data with dictionaries that exist already, by block."""

    def __init__(self, model: Model, dictionaries: Mapping[str, Dictionary]) -> None:
        super().__init__(model, lambda: (), Products(None))
        self._given = dictionaries

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        return self._given[name], 0.0


def projected(
    model: Model, integrator: Integrator, h: float, solver: StepSolver,
    supports: Mapping[str, BoolArray], registry: Registry | None = None,
) -> StepSolver:
    """Galerkin model on the span of the active atoms, which are orthonormalised.

    solver: reduced model with the atoms; supports: block -> mask of its active atoms, all atoms of
    a block that is not named; h: step size, s. Raises SolveFailed where the projected blocks are
    singular.
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
    """Full-order states of a run of the given solver, at the multiples of its step h (s) nearest to
    `times` (s, 0 is the start).

    Raises SolveFailed when the run stops before the last of them.
    """
    due = {round(t / h) for t in times}
    found = {0: start}
    state, memory = started(solver, integrator, start)
    step = FixedStep.of(integrator, solver, h)
    for n, taken in enumerate(accepted_steps(step, state, memory, max(due), h), 1):
        if n in due:
            found[n] = full_state(solver, taken.state)
    return [found[round(t / h)] for t in times]


def linearization_times(h: float, steps: int) -> tuple[float, ...]:
    """Times of the linearisations, s."""
    return tuple(h * n for n in state_steps(steps))


def states_along(
    model: Model, integrator: Integrator, h: float, solver: StepSolver, start: State,
    times: Sequence[float], registry: Registry | None = None, known: Sequence[State] = (),
) -> list[State]:
    """Full-order states near `times` (s): those that are known, else of a run of the Galerkin model
    with the solver's atoms, in `COARSE` to 2 `COARSE` steps where there are as many (these states
    are points of the motion to linearise at, not its solution); the initial state alone if that
    model cannot be built, stops early, or has too many atoms.

    Also for integrators of higher order only the initial state: they damp little, and oscillating
    frames then grow in each linearised map without growing in the run.
    """
    many = sum(d.atoms.shape[1] for d in solver.dictionaries.values()) > MANY
    if many or integrator.order > 1 or not any(times):
        return [start]
    if known:
        return list(known)
    longer = max(1, round(times[-1] / h) // COARSE)  # steps of h in one of the Galerkin model
    for H in sorted({h * longer, h}, reverse=True):
        try:
            twin = projected(model, integrator, H, solver, {}, registry)
            return along(twin, integrator, H, start, times)
        except (SolveFailed, InputError):  # a long step may fail where the steps of the run do not
            continue
    return [start]


def times_checked(times: Sequence[float], h: float, end: float) -> tuple[float, ...]:
    """The times (s) as a tuple. Raises InputError (key `at`) for times that are no step of the
    run."""
    for t in times:
        if not 0.0 <= t <= end * (1 + 1e-9) or abs(round(t / h) * h - t) > 1e-6 * h:
            raise InputError(f"{t:g} s is no time of the run: take multiples of {h:g} s from 0 to "
                             f"{end:g}", "at")
    return tuple(times)


def _orthonormal(d: Dictionary, support: BoolArray | None) -> Dictionary:
    use = slice(0, 1) if support is not None and not support.any() else support
    q = np.linalg.qr(d.atoms if use is None else d.atoms[:, use])[0]
    return Dictionary(q, d.offset, tuple(map("span {}".format, range(q.shape[1]))))
