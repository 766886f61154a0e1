"""Stages of a run before its first step: choices that a scene leaves to trial runs, model, training
run, trial bases, step solver, consistent start, checks; header of the result."""

import platform
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import described
from sparsemor.core.model.assembly import BodyCache, with_joints
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.core.model.initial_state import resolved_start, start_notes
from sparsemor.core.model.model import Model
from sparsemor.core.model.redundancy import undetermined_forces
from sparsemor.core.notes import Note
from sparsemor.core.protocols.reducer import ErrorEstimator, StepFactors
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.registry.installed import entry_points
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.simulation.controllers import controllers_of
from sparsemor.core.simulation.initial_from_result import initial_notes
from sparsemor.core.simulation.memory.estimate import fitting, room_for_snapshots
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.simulation.step_control import controlled
from sparsemor.core.simulation.time_stepping import problem_of
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.simulation.validation import checked_model

CHOICE = "choice"
"""Kind of the functions that make explicit what a scene leaves to trial runs, such as its reducer:
scene, cache, manager of events and built bodies -> the scene with what
is chosen and notes on that, or the same scene if it leaves nothing to choose."""



def prepared_run(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None,
    estimated: bool = False,
) -> tuple[PreparedRun, Offline]:
    """A run prepared for its first step, and its offline data. estimated: as for `reduced`. Raises
    InputError and SolveFailed as the stages do."""
    model, offline = prepared(scene, cache, manager, body_cache)
    train(scene, model, offline)
    build_bases(scene, model, offline)
    return checked(reduced(scene, model, offline, estimated)), offline


def prepared_again(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache,
    kept: tuple[PreparedRun, Offline], atoms: int | None = None, estimated: bool = False,
) -> PreparedRun:
    """A run of the scene of a prepared run with other values of its parameters: its trial bases (or
    their first `atoms` atoms) and findings are used again. kept: that run, and its offline data;
    estimated: as for `reduced`. Raises as `prepared_run`."""
    products = Products(cache)
    model = checked_model(scene, body_cache) if scene.rigid_stage is None else _after_stage(
        scene, products, manager, body_cache)
    offline = kept[1].of_model(model, products, atoms)
    return checked(reduced(scene, model, offline, estimated), kept[0])


# ------------------------------------------------------------------ stages


def explicit(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None
) -> Scene:
    """The scene with all that is chosen for it, by each function of the kind `CHOICE` in turn.
    Raises InputError and SolveFailed as trial runs do."""
    registry = scene.source.registry
    for plugin in registry.names(CHOICE):
        choose = registry.load(CHOICE, registry.spelling(plugin))
        made = choose(scene, cache, manager, body_cache or BodyCache())
        if not isinstance(made, Scene):
            raise InputError(f"choice {plugin.name!r} returned no scene: report it to the authors "
                             f"of {plugin.distribution}")
        scene = made
    return scene


def prepared(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None
) -> tuple[Model, Offline]:
    """Model of a scene after all input checks, and its offline data, of which nothing is made yet.
    The rigid-body pre-simulation of a two-stage scene is run here, or read from the cache.

    Raises InputError as `checked_model` does, and if the run would not fit in memory or its
    snapshots not on the disk; SolveFailed if the pre-simulation stops early.
    """
    body_cache, products = body_cache or BodyCache(), Products(cache)
    model = checked_model(scene, body_cache) if scene.rigid_stage is None else _after_stage(
        scene, products, manager, body_cache)
    offline = offline_of(scene, model, products, manager, body_cache)
    offline.expected = fitting(scene, model, offline).total
    room_for_snapshots(scene, model, offline)
    return model, offline


def _after_stage(
    scene: Scene, products: Products, manager: Manager, body_cache: BodyCache
) -> Model:
    """Model of a two-stage scene after all input checks and the pre-simulation."""
    checked_model(scene, body_cache)  # which is not held next to the one that is run
    return staged(scene, products, manager, body_cache)


def train(scene: Scene, model: Model, offline: Offline) -> None:
    """Makes the training runs, if a basis that the cache does not have needs them and they are not
    in the cache. Raises SolveFailed if one stops early."""
    if scene.reducer.full_order or offline.has_training():
        return
    step = _factors(scene)
    if any(basis.needs_snapshots and not offline.has_dictionary(name, basis, step)
           for name, basis in fitted_bases(model, scene.reducer).bases.items()) or any(
            basis.needs_snapshots for basis in scene.reducer.force_bases_used()):
        offline.train()


def build_bases(scene: Scene, model: Model, offline: Offline) -> None:
    """Builds the trial bases of all reducible blocks, or reads them from the cache. Raises
    InputError, with the block, for a basis that cannot be computed."""
    step = _factors(scene)
    for name, basis in fitted_bases(model, scene.reducer).bases.items():
        try:
            offline.dictionary(name, basis, step)
        except InputError as error:
            raise InputError(f"{name}: {error}", "reducer.basis") from None


def _factors(scene: Scene) -> StepFactors:
    """Size and factors of the steps of a scene."""
    return StepFactors(scene.time.step, *scene.integrator.rules(scene.time.step).factors)


@np.errstate(all="ignore")  # overflow ends in a status, not in a warning
def reduced(
    scene: Scene, model: Model, offline: Offline, estimated: bool = False, every: int = 0
) -> PreparedRun:
    """The run with its step solver, for steps of one size, and its consistent start; estimated:
    with an estimate of its error where the scene leaves that open and all steps and loads are known
    before; every: as for `ReducedProblem`. Raises InputError as the reducer, SolveFailed for
    singular matrices."""
    h, integrator, reducer = scene.time.step, scene.integrator, scene.reducer
    model, undetermined = _determined(scene, model, offline)
    known = not controllers_of(scene)  # all loads are known before the run
    problem = replace(problem_of(scene, model, offline), steps=step_count(scene),
                      estimated=estimated and known and scene.time.control is None, every=every)
    solver: StepSolver = reducer.prepare(problem)
    complete(solver, StepSolver, reducer, "prepare", "reducer")
    start = resolved_start(model, integrator, h)
    estimator = reducer.error_estimator(problem, solver) if known else None
    # rates of BDF1 are differences of positions, so that joints hold at the end of a step only
    differences = scene.initial is not None and integrator.order == 1
    notes = (
        *(() if differences else start_notes(model)),
        *initial_notes(scene, model, solver.dictionaries), *start.notes(h),
        *integrator.notes(model.layout), *undetermined)
    return PreparedRun(
        scene, solver, start.state,
        header=header_of(scene, model, solver, step_count(scene), estimator),
        probes=tuple(ProbeReader.at_place(
            p, solver.layout, solver.dictionaries) for p in model.probes),
        given={n: shape for n, shape in model.shapes().items() if shape.given}, notes=notes,
        trained_to=scene.training_end if offline.trained else None, model=model,
        estimator=estimator, offline=offline, own_loads=known, forces=tuple(
            ForceReader.from_force(name, joint.force, solver.layout)
            for name, joint in model.joints.items() if joint.force is not None))


def _determined(
    scene: Scene, model: Model, offline: Offline
) -> tuple[Model, tuple[Note, ...]]:
    """The model with joint forces of least norm where its trial spaces determine none, and notes on
    joints that have none of least norm."""
    # joint -> the joint with compliant constraints, None if it has no such form, and a note; none
    # where full-order rows at the joints determine their forces
    step = _factors(scene)
    found = {} if scene.reducer.keeps_joint_rows else undetermined_forces(
        model, scene.time.step, {
            n: offline.dictionary(n, basis, step)[0]
            for n, basis in fitted_bases(model, scene.reducer).bases.items()})
    changed = {n: made for n, (made, _) in found.items() if made is not None}
    notes = tuple(note for made, note in found.values() if made is None)
    return with_joints(scene, model, changed) if changed else model, notes


@np.errstate(all="ignore")
def checked(run: PreparedRun, again: PreparedRun | None = None) -> PreparedRun:
    """The run with what checks find before its first step, and with steps of controlled error if
    its scene has them. again: a run of the same bases with other values of parameters. Raises
    InputError for a run that its scene asks to refuse."""
    scene, model, offline = run.scene, run.model, run.offline
    assert model is not None and offline is not None
    checks = Checks.for_scene(scene)
    found = checks.before_steps(run, again)
    solver = controlled(scene, model, offline, run.solver)
    estimator = () if run.estimator is None else run.estimator.notes
    return replace(
        run, solver=solver, summary=found.summary, kept=found.kept, changes=found.changes, notes=(
            *run.notes, *solver.notes, *checks.of_model(scene, model), *found.notes, *estimator))


# ------------------------------------------------------------------ header of the result


def header_of(
    scene: Scene, model: Model, solver: StepSolver, steps: int,
    estimator: ErrorEstimator | None = None,
) -> RunHeader:
    """Header of the result of a run of `steps` steps. estimator: of its error."""
    # contacts: names of their resultants, of which those along a rigid stage are in the stage
    return replace(
        full_order_header(scene, model, steps), layout=solver.layout,
        dictionaries=solver.dictionaries, rows=solver.rows,
        probes=tuple(ProbeReader.at_place(p, solver.layout, solver.dictionaries).header()
                     for p in model.probes),
        stage=model.stage,
        contacts={a.name: a.term.histories for a in solver.resultant_sources(None)}
        if model.stage is None else {}, estimates=() if estimator is None else estimator.blocks,
        estimates_every=0 if estimator is None else estimator.every)


def full_order_header(scene: Scene, model: Model, steps: int) -> RunHeader:
    """Header of a result in the unknowns of the model, without resultants of contacts."""
    # one reading of metadata for each distribution, not for each of its plugins
    offering = {e.dist for e in entry_points() if e.dist is not None}
    names = {"sparsemor", "numpy", "scipy", "scikit-fem", "pydantic", *(d.name for d in offering)}
    return RunHeader(
        scene=scene.dump(), scene_digest=scene.digest(), seed=scene.seed,
        identity=Identity.from_scene(scene).plain(), platform=described(),
        versions={"python": platform.python_version()} | {n: version(n) for n in sorted(names)},
        reducer=scene.reducer_name, layout=model.layout, full_layout=model.layout,
        step=scene.time.step, steps_planned=steps, bodies=model.shapes(),
        probes=tuple(ProbeReader.at_place(p, model.layout, {}).header() for p in model.probes),
        multipliers=model.multiplier_components,
        forces={n: joint.force.component for n, joint in model.joints.items()
                if joint.force is not None},
    )
