"""Input checks before the first step of a run, its training run included."""

import math

import numpy as np

from sparsemor.core.errors import Fault, Gather, InputError
from sparsemor.core.model.assembly import BodyCache, assemble
from sparsemor.core.model.block_patterns import unmatched_patterns
from sparsemor.core.model.model import Model
from sparsemor.core.model.prescribed_quantities import NOTHING, AtStart
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.controllers import controller_faults
from sparsemor.core.simulation.initial_from_result import started_from_result
from sparsemor.core.simulation.memory.estimate import check_memory, chosen_bases, grid_refusal
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.rigid_stage import check_rigid, rigid_scene, stage_faults

ESTIMATE = "reducer.error_estimate"


@np.errstate(all="ignore")  # overflow ends in a refusal or in a status, not in a warning
@naming_plugins()
def checked_model(scene: Scene, body_cache: BodyCache | None = None) -> Model:
    """Assembled model of a scene after all input checks; for a two-stage scene the flexible model
    before the pre-simulation, with all prescribed motion and loads as at the start. Raises
    InputError with every fault that can be found without a time step. body_cache: keeps the bodies
    for the run that follows.

    The checks of the reducer add their own faults.
    """
    gather, body_cache = Gather(), body_cache or BodyCache()
    gather.faults += endless(scene)
    gather.check()  # nothing can be counted on such a grid
    gather.faults += time_faults(scene)
    before = len(gather.faults)
    with gather.under(""):
        check_memory(scene)
    if len(gather.faults) > before:  # what does not fit is not meshed
        gather.check()
    faults = gather("", stage_faults, scene)
    gather.faults += faults or []
    model: Model | None = None
    with gather.under(""):
        if scene.rigid_stage is None:
            model = started_from_result(scene, assemble(scene, body_cache=body_cache))
        else:
            model = assemble(scene, AtStart(), body_cache)
    if model is not None and scene.rigid_stage is not None and faults == []:
        gather("", check_rigid, scene, body_cache)
    if model is not None:
        gather.faults += unmatched_patterns(model.layout, "linear_solvers", scene.linear_solvers)
        gather.faults += unknown_fields(scene, model)
        gather.faults += controller_faults(scene, model)
        gather.faults += training_faults(scene, model, body_cache)
    gather.faults += control_faults(scene)
    if model is not None and scene.rigid_stage is None:  # else the loads are not known yet
        gather.faults += basis_faults(scene, model)
    if model is not None:
        gather.faults += InputError(list(scene.reducer.check(model))).under("reducer").faults
    gather.check()
    assert model is not None
    return model


def unknown_fields(scene: Scene, model: Model) -> list[Fault]:
    """Faults of sizes in `time.control.fields` for a field that no body has."""
    named = [] if scene.time.control is None else list(scene.time.control.fields)
    known = [k.name for k in model.layout.kinds if k.order > 0]
    return [Fault(f"time.control.fields.{name}", f"no body has such a field: "
                  f"{suggestions(name, known, 'fields')}") for name in named if name not in known]


def control_faults(scene: Scene) -> list[Fault]:
    """Fault of error-controlled steps with a reducer that cannot return to the state before a
    step."""
    why = "" if scene.time.control is None else scene.reducer.restart_refusal()
    return [Fault("time.control", why)] if why else []


def basis_faults(scene: Scene, model: Model) -> list[Fault]:
    """Faults of blocks that their basis would refuse after the training run, whatever the snapshots
    are."""
    faults: list[Fault] = []
    for name, basis in chosen_bases(scene, model.reducible(), model).items():
        why = basis.unfit(model.block_data(name))
        faults += [Fault("reducer.basis", f"{name}: {why}")] if why else []
    return faults


def endless(scene: Scene) -> list[Fault]:
    """Faults of time grids (run, training run, rigid-body pre-simulation) with more steps than can
    be computed and recorded."""
    grids = [("time.step", scene)]
    gather = Gather()  # of faults of the other scenes themselves, which other checks report
    if "training" in scene.model_fields_set:
        key = "training.end" if scene.training.end is not None else "training.overrides"
        with gather.under(""):
            grids.append((key, scene.for_training()))
    if scene.rigid_stage is not None:
        with gather.under(""):
            grids.append(("rigid_stage.overrides", rigid_scene(scene)))
    found: dict[str, Fault] = {}
    for key, one in grids:
        refusal = grid_refusal(one.time.end, one.time.step)
        if refusal and refusal not in found:  # a stage on the grid of the run says nothing new
            found[refusal] = Fault(key, refusal)
    return list(found.values())


def training_faults(scene: Scene, model: Model, body_cache: BodyCache) -> list[Fault]:
    """Faults of `training.overrides` that change the number of unknowns, so that snapshots do not
    fit the run."""
    if not scene.training.overrides:
        return []
    gather, key = Gather(), "training.overrides"
    training = gather("", scene.for_training)
    parts = ("bodies", "joints")
    if training is None or training.digest(*parts) == scene.digest(*parts):
        return []  # `time_faults` has what is wrong with the overrides themselves
    other = gather("", assemble, training, NOTHING if scene.rigid_stage is None else AtStart(),
                   body_cache)
    if other is None:
        return [Fault(key, f"{f.key}: {f.message}" if f.key else f.message)
                for f in gather.faults]
    found = []
    for name in model.reducible():
        here, there = (m.layout[name] if name in m.layout else slice(0, 0) for m in (model, other))
        count, trained = here.stop - here.start, there.stop - there.start
        if count != trained:
            found.append(Fault(key, f"the training run has {trained} unknowns of {name}, and the "
                               f"run {count}: change neither mesh, fields nor reference there"))
    return found


def time_faults(scene: Scene) -> list[Fault]:
    """Faults of end times that are not a whole number of steps, of a training run that would
    store only its initial state, and of error estimates that would begin after the run."""
    faults = [] if _whole(scene.time.end, scene.time.step) else [
        _not_whole("time.end", scene.time.end, scene.time.step)]
    steps, every = step_count(scene), scene.reducer.error_limit.every
    if every > steps:
        faults.append(Fault(ESTIMATE, f"the run has {steps} steps, so no error would be "
                            f"estimated: take at most {steps} (got {every})"))
    if "training" not in scene.model_fields_set:
        return faults
    try:
        training = scene.for_training()
    except InputError as error:
        return [*faults, *error.faults]
    end, step = training.time.end, training.time.step
    if scene.training.end is not None and not _whole(end, step):
        faults.append(_not_whole("training.end", end, step))
    steps, every = step_count(training), scene.training.every
    if every > steps:
        faults.append(Fault("training.every", f"the training run has {steps} steps, so only its "
                            f"start would be kept: take at most {steps} (got {every})"))
    return faults


def _whole(end: float, step: float) -> bool:
    """True if an end time is a whole number of steps, both s, up to 1e-6 steps."""
    return abs(round(end / step) * step - end) <= 1e-6 * step


def _not_whole(key: str, end: float, step: float) -> Fault:
    """Fault of an end time between two steps, both s, with the nearest ones that are not."""
    below = max(math.floor(end / step), 1) * step
    return Fault(key, f"{end:g} s is not a whole number of steps of {step:g} s ({end / step:.6g} "
                 f"steps): take {below:.6g} or {below + step:.6g}")
