"""Preparation of a run: input checks, model, rigid-body pre-simulation, offline data, step solver
and the checks before the first step."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.model.initial_state import start_notes
from sparsemor.core.model.model import Model
from sparsemor.core.model.resolved_start import resolved_start
from sparsemor.core.notes import Note
from sparsemor.core.protocols import (
    ChecksLayout,
    Dictionary,
    ErrorEstimator,
    EstimatesErrors,
    HasForceLaw,
    ReducedProblem,
    StepSolver,
)
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.scene.parameters import Point, values_at
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.simulation.diagnostics.trial_space import (
    TRIAL_SPACE,
    check_trial_spaces,
)
from sparsemor.core.simulation.greedy import estimated_error, greedy_points, trial_scene
from sparsemor.core.simulation.initial_from_result import initial_notes
from sparsemor.core.simulation.linearization import check_run
from sparsemor.core.simulation.linearization.check import UNSTABLE
from sparsemor.core.simulation.memory.disk import room_for_result, room_for_snapshots
from sparsemor.core.simulation.memory.estimate import fitting
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.simulation.run_header import header_of
from sparsemor.core.simulation.step_control import controlled
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.simulation.validation import checked_model

Kept = tuple[PreparedRun, Offline]
"""A prepared run and its offline data."""


def prepared_run(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None,
    out: Path | None = None, kept: Kept | None = None, atoms: int | None = None,
) -> tuple[PreparedRun, Offline]:
    """A run prepared for its first step, and its offline data. out: directory for the result, None
    if nothing will be written. kept: preparation of the same scene with other values of parameters,
    whose trial bases (or their first `atoms` atoms) and findings are used again.

    Raises InputError and SolveFailed as `prepared` does, and InputError if `out` has no room for
    the result, or the model is unstable and the scene asks to refuse that.
    """
    if kept is None:
        model, offline = prepared(scene, cache, manager, body_cache)
    else:
        products = Products(cache)
        model = _model(scene, products, manager, body_cache or BodyCache())
        offline = kept[1].of_model(model, products, atoms)
    if out is not None:
        room_for_result(scene, model, out)
    with np.errstate(all="ignore"):  # overflow ends in a status, not in a warning
        problem = ReducedProblem(
            model, scene.integrator, scene.time.step, offline, np.random.default_rng(scene.seed))
        solver: StepSolver = scene.reducer.prepare(problem)
        complete(solver, StepSolver, scene.reducer, "prepare", "reducer")
        resolved = resolved_start(model, scene.integrator, scene.time.step)
        start = resolved.state
        unstable, stability = check_run(scene, model, solver, start, offline) if kept is None else (
            _of_kind(UNSTABLE, kept[0]), kept[0].stability)
        same = kept is not None and _equal(kept[0].header.dictionaries, solver.dictionaries)
        spaces, missed = (kept[0].spaces, _of_kind(TRIAL_SPACE, kept[0])) if kept and same else (
            check_trial_spaces(scene, model, offline, solver.dictionaries))
        estimator = _estimator(scene.reducer, problem, solver)
        solver = controlled(scene, model, offline, solver)
    integrator: object = scene.integrator
    # rates of BDF1 are differences of positions, so that joints hold at the end of a step only
    differences = scene.initial is not None and scene.integrator.order == 1
    started = () if differences else start_notes(model)
    of_integrator = integrator.notes(model.layout) if isinstance(integrator, ChecksLayout) else ()
    run = PreparedRun(
        scene, solver, start, header_of(
            scene, model, solver, step_count(scene), () if estimator is None else estimator.blocks),
        tuple(ProbeReader.of(p, solver.layout, solver.dictionaries) for p in model.probes),
        {n: shape for n, shape in model.shapes().items() if shape.given}, (),
        stability, spaces, scene.training_end, model, estimator, offline, forces=tuple(
            ForceReader.of(name, part, solver.layout) for name, part in model.parts.items()
            if isinstance(part, HasForceLaw)))
    checks = Checks.of(scene)
    return replace(run, notes=(
        *started, *initial_notes(scene, model, solver.dictionaries),
        *resolved.notes(scene.time.step), *of_integrator, *solver.notes,
        *checks.of_model(scene, model), *checks.before_steps(run), *unstable, *missed,
        *offline.notes, *(() if estimator is None else estimator.notes))), offline


def prepared(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None
) -> tuple[Model, Offline]:
    """Model and offline data from which a reducer is prepared. The rigid-body pre-simulation of a
    two-stage scene is run here, or read from the cache.

    Raises InputError as `checked_model` does, and if the run would not fit in memory or its
    snapshots not on the disk; SolveFailed if the pre-simulation stops early.
    """
    body_cache, products = body_cache or BodyCache(), Products(cache)
    model = _model(scene, products, manager, body_cache)

    def trial(points: Sequence[Point]) -> Callable[[Point], float]:
        """Estimated error, at a point of the box, of the model that is trained at `points`."""
        of = trial_scene(scene, points)
        kept = prepared_run(of, cache, manager, body_cache)

        def error(point: Point) -> float:
            run, _ = prepared_run(
                of.using(values_at(point)), cache, manager, body_cache.of_bodies(), kept=kept)
            return estimated_error(run.scene, run.solver, run.start, run.estimator)

        return error

    offline = offline_of(scene, model, products, manager, body_cache,
                         lambda: greedy_points(scene, products, trial))
    offline.expected = fitting(scene, model, offline).total
    room_for_snapshots(scene, model, offline)
    return model, offline


def _model(scene: Scene, products: Products, manager: Manager, body_cache: BodyCache) -> Model:
    if scene.rigid_stage is None:
        return checked_model(scene, body_cache)
    checked_model(scene, body_cache)  # which is not held next to the one that is run
    return staged(scene, products, manager, body_cache)


def _of_kind(kind: str, run: PreparedRun) -> tuple[Note, ...]:
    return tuple(n for n in run.notes if n.kind == kind)


def _equal(one: Mapping[str, Dictionary], other: Mapping[str, Dictionary]) -> bool:
    return all(np.array_equal(d.atoms, other[n].atoms) for n, d in one.items())


def _estimator(
    reducer: object, problem: ReducedProblem, solver: StepSolver
) -> ErrorEstimator | None:
    """Estimator of the error of the coming run, if the reducer has one and its options request
    it."""
    if not isinstance(reducer, EstimatesErrors):
        return None
    return reducer.error_estimator(problem, solver)
