"""Greedy choice of training runs in the box of parameters: where a run of the reduced model
estimates the largest error, a full-order run is added to its training."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf, isfinite
from typing import Any

import numpy as np

from sparsemor.core import ErrorEstimator, State, StepSolver
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.notes import Note
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.parameters_and_training_points import Point, values_at
from sparsemor.core.scene.run_identity import Identity, physics_of
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.error_record import ErrorRecord
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.stages_before_steps import prepared_again, prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, started
from sparsemor.core.status import SolveFailed

EVERY = 10
"""Steps from one estimate of the error to the next, unless the reducer has another number."""
CHOICE = "training.parameters.choice"


def with_points(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache
) -> Scene:
    """The scene with the points of its training runs. Raises InputError for a reducer without
    estimated errors, SolveFailed if a training run fails."""
    points, notes = greedy_points(
        scene, Products(cache), partial(_trial_errors, scene, cache, manager, body_cache))
    made = scene.using(
        {"training.parameters": {"points": [dict(p) for p in points]}}, label="greedy")
    return made.with_notes((*(n for n in scene.notes if n not in made.notes), *notes))


def _trial_errors(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache,
    points: Sequence[Point], candidates: Sequence[Point],
) -> list[float]:
    """Estimated errors at candidates of the reduced model that is trained at `points`; infinite
    where its run fails."""
    trained, errors = trial_scene(scene, points), list[float]()
    kept = prepared_run(trained, cache, manager, body_cache)
    for point in candidates:
        there = trained.using(values_at(point))
        try:
            run = prepared_again(there, cache, manager, body_cache.of_bodies(), kept)
            errors.append(estimated_error(run.scene, run.solver, run.start, run.estimator))
        except SolveFailed:
            errors.append(inf)
    return errors


def greedy_points(
    scene: Scene, products: Products,
    trial: Callable[[Sequence[Point], Sequence[Point]], list[float]],
) -> tuple[list[Point], tuple[Note, ...]]:
    """Points of the training runs of a scene with `training.parameters.choice: greedy`, cached, and
    a warning if so many do not attain the tolerance.

    trial(points, candidates): the estimated errors at candidates of the reduced model that is
    trained at `points`. The candidate with the largest one is added, until it is at most the
    tolerance. Raises InputError where no block has an estimate.
    """
    box = scene.training.parameters
    assert box is not None
    names, count = list(scene.parameters), box.runs(scene.parameters)

    def make() -> Mapping[str, Any]:
        # the points that training begins with, and those from which others are taken
        chosen, candidates = box.chosen(scene.parameters), box.others(scene.parameters)
        errors = [inf]
        while len(chosen) < count:
            errors = trial(chosen, candidates)
            worst = int(np.argmax(errors))
            if errors[worst] <= box.tolerance or candidates[worst] in chosen:
                break
            chosen.append(candidates[worst])
        return {"points": np.array([[p[n] for n in names] for p in chosen]),
                "error": np.array(max(errors))}

    # the same at all values of the parameters
    physics = physics_of(scene.using(values_at(box.chosen(scene.parameters)[0])), "greedy")
    arrays = products.remember("greedy", digest(
        physics.digest(), box, dict(scene.parameters), Identity.from_scene(scene).plain()), make)
    points: list[Point] = [dict(zip(names, map(float, row), strict=True))
                           for row in np.asarray(arrays["points"])]
    error = float(arrays["error"])
    return points, () if error <= box.tolerance else (Note(
        f"with {len(points)} training runs, the estimated error in the box of parameters was "
        f"{error:.2g} before the last one was added (tolerance {box.tolerance:g}): allow more "
        "samples, or take more atoms", "training_tolerance"),)


def trial_scene(scene: Scene, points: Sequence[Point]) -> Scene:
    """Scene of the reduced model that is trained at `points`, with error estimates. Raises
    InputError for a reducer that has none."""
    every: Any = scene.dump()["reducer"].get("error_estimate")
    if every in ("auto", "on", "off", 0, None):  # no number of steps between two estimates
        every = min(EVERY, step_count(scene))
    try:
        return scene.using({
            "training.parameters": {"points": [dict(p) for p in points]},
            "reducer.error_estimate": every, "check_stability": "off"}, label="greedy")
    except InputError as error:
        raise InputError(f"greedy needs estimated errors: {error}", CHOICE) from None


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def estimated_error(
    scene: Scene, solver: StepSolver, full: State, estimator: ErrorEstimator | None
) -> float:
    """Largest estimated error of any block over a run from the state `full`, relative to the
    block's largest change; infinite for a run that fails."""
    if estimator is None or not estimator.blocks:
        raise InputError("greedy needs estimated errors, which no block of this scene has: take "
                         "latin_hypercube or corners", CHOICE)
    state, memory = started(solver, scene.integrator, full)
    record, states = ErrorRecord(estimator, full, state), [state.x]
    record.store()
    step = step_of(solver, scene.integrator, scene.time.step)
    for n, taken in enumerate(iterate(step, state, memory, step_count(scene)), 1):
        if not taken.outcome.status.ok:
            return inf
        record.take(taken.state, n)
        record.store()
        states.append(taken.state.x)
    worst, X = 0.0, np.stack(states)
    for name, errors in record.stored().items():
        d, c = solver.dictionaries.get(name), X[:, solver.layout[name]]
        # |R c| = |atoms c|, so that changes of the field are those of k coefficients
        R = np.eye(c.shape[1]) if d is None else np.asarray(np.linalg.qr(d.atoms, mode="r"))
        change = float(np.linalg.norm((c - c[0]) @ R.T, axis=1).max())
        size = float(np.linalg.norm(c[0] if d is None else d.offset + d.atoms @ c[0]))
        scale = change if change > CONSTANT_CHANGE * size else size
        worst = max(worst, float(errors.max()) / (scale or 1.0))
    return worst if isfinite(worst) else inf
