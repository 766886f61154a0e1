"""Reduced model that is prepared once, run many times, and kept in a file."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields as fields_of
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from sparsemor.core.errors import Fault, InputError, PluginError, check_count
from sparsemor.core.linalg.threads import described, fixed_threads
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.model.initial_state import FAR, START
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.reducer import ErrorEstimator
from sparsemor.core.protocols.step_solver import StepMemory, StepSolver
from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.registry.value_types import unfit_field
from sparsemor.core.results.arrays_in_memory import MemoryWriter
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.output_lock import owned
from sparsemor.core.results.result_variables import fixed_arrays, time_arrays
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.html import html_table
from sparsemor.core.scene.option_tree import changes, functions_of_time, nested
from sparsemor.core.scene.overrides import inside, split
from sparsemor.core.scene.parameters_and_training_points import values_at
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.scene.yaml_reader import LocatedError
from sparsemor.core.simulation.blow_up import Extents
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.checks import KIND, Checks, Findings
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.core.simulation.recorder import Recorder, StepStatistics, kept
from sparsemor.core.simulation.run_steps import RunSteps
from sparsemor.core.simulation.stages_before_steps import explicit, prepared_again, prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import full_state, in_blocks, many_steps, started
from sparsemor.core.simulation.validation import ESTIMATE, endless, time_faults
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.kept_models.changeable_options import FREE, load_functions
from sparsemor.plugins.kept_models.changed_start import (
    Initial,
    block_faults,
    start_notes,
    started_from,
)
from sparsemor.plugins.kept_models.co_simulation import Input, ModelStepper
from sparsemor.plugins.kept_models.serializer import Packed, PackedError, Table, table_of
from sparsemor.plugins.kept_models.stored_classes import CLASSES

Again = Callable[[Scene, int | None], PreparedRun]
"""Preparation of a scene with other values of parameters on the same trial bases, or on so many of
their first atoms."""
RUNS = 50
"""Number of runs for which a kept model is made: its steps are compiled where so many have the
steps that this takes."""
FIRST_STEPS = 3
"""Number of steps of which the last ones are compiled: the first one is never."""
NO_MESH = "a model from a file is without the mesh that an estimate needs"


@naming_plugins()
@fixed_threads()
def reduce(
    scene: Scene, *, observers: Sequence[object] = (), cache: Cache | None = None,
    body_cache: BodyCache | None = None, progress: bool = False, estimate: bool = True,
) -> "ReducedModel":
    """Reduced model of a scene, prepared up to its first step: meshed, trained, projected, checked.

    observers, cache, body_cache, progress, estimate: as for `simulate`. Raises InputError for bad
    input and for a reducer that reduces nothing, SolveFailed if the training run fails.
    """
    begun, cache = time.perf_counter(), cache or Cache()
    bodies = BodyCache() if body_cache is None else body_cache.of_bodies()
    with progress_bar(progress) as bar:
        manager = new_manager((*observers, *bar))
        scene = explicit(scene, cache, manager, bodies)
        if scene.reducer.full_order:
            raise InputError(f"{scene.reducer_name} reduces nothing: name a reducer that has a "
                             "trial basis", "reducer")
        # not a model of the trial runs, whose loads are objects of another scene
        run, offline = prepared_run(scene, cache, manager, bodies.of_bodies(), estimate)
    kept = run, offline.without_snapshots()

    def again(changed: Scene, atoms: int | None = None) -> PreparedRun:
        return prepared_again(
            changed, cache, new_manager(()), bodies.of_bodies(), kept, atoms, estimate)

    return ReducedModel(run, offline.products.spent.whole(time.perf_counter() - begun), again)


def load_model(path: str | Path, *, registry: Registry | None = None) -> "ReducedModel":
    """Reduced model from a file that `ReducedModel.save` wrote. Neither mesh nor training nor the
    folder of the scene is needed.

    The file is data: it names classes that the plugins of its scene declare, and no others are
    used. Raises InputError for a file that is no such model, is damaged, or needs a plugin that is
    not installed.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    with usable(str(path)):
        return _unpacked(data, registry, str(path))


@contextmanager
def usable(file: str) -> Iterator[None]:
    """Context in which a model from a file that fits no object or no step is refused in one line;
    without a file, for a model of this process, nothing is done. Raises InputError."""
    try:
        yield
    except (SolveFailed, OSError):
        raise
    except Exception as error:
        plain = isinstance(error, InputError) and not isinstance(error, LocatedError)
        if not file or plain and not (isinstance(error, PluginError) and error.own):
            raise
        cause = error.__cause__ or error
        input_fault = isinstance(error, PackedError | LocatedError) or isinstance(cause, InputError)
        message = str(error) if input_fault else f"{type(cause).__name__}: {cause}"
        line, *more = message.splitlines() or [""]
        raise InputError(
            f"{file} is no reduced model that this program can use: {line}"
            f"{f' (and {len(more)} more)' if more else ''}; save it again from its scene"
        ) from error


def _unpacked(data: bytes, registry: Registry | None, file: str = "") -> "ReducedModel":
    """The model from the bytes of its file: `about` has the name and the data of its scene, the
    objects are the other fields of a PreparedRun, by name. file: path of a file, for messages.
    Raises PackedError for what is no model that fits itself."""
    packed = Packed.load(data)
    scene = build(Source.of_tree(packed.about["scene"], registry, packed.about["name"]))
    parts = packed.made(_table(scene), _functions(scene))
    header, solver = parts.pop("header"), parts["solver"]
    if not (isinstance(header, RunHeader) and isinstance(solver, StepSolver)
            and solver.leaves_mesh):
        raise PackedError("it holds something else")
    if faults := [*endless(scene), *time_faults(scene)]:
        raise PackedError(faults[0].message)
    run = PreparedRun(
        scene=scene, header=replace(header, scene=scene.dump(), platform=described()), **parts)
    if wrong := unfit_field(run):
        raise PackedError(wrong)
    _check_consistent(run)
    return ReducedModel(run, file=file)


def _check_consistent(run: PreparedRun) -> None:
    """Raises PackedError, ValueError or TypeError where unknowns, state and trial bases differ in
    size, by which memory is taken, or where the header cannot be stored."""
    layout, start = run.header.layout, run.start
    json.dumps(run.header.attributes(), allow_nan=False)  # as a result writes them
    time_arrays(run.header)
    if layout.parts() != run.solver.layout.parts() or run.header.steps_planned != step_count(
            run.scene):
        raise PackedError("its header and its step solver differ")
    if not {a.shape for a in (start.x, start.v, start.a)} <= {
            (layout.size,), (run.header.full_layout.size,)}:
        raise PackedError(f"a state of {start.x.shape} for {layout.size} unknowns")
    for extent in run.extents.blocks:
        A, b = extent.atoms, extent.offset
        k = layout.block(extent.name).size
        if extent.at != layout[extent.name] or A is not None and (
                b is None or A.ndim != 2 or A.shape[1] != k or b.shape != A.shape[:1]):
            raise PackedError(f"{extent.name}: an extent of other unknowns")
    for name, made in run.header.dictionaries.items():
        if made.atoms.ndim != 2 or made.atoms.shape[1] != layout.block(name).size:
            raise PackedError(f"{name}: a trial basis of {made.atoms.shape}")


class ReducedModel:
    """A reduced model that is prepared once and run many times.

    A run may change the keys in `free`: title, output, end of the run, and functions of time of
    loads; the rigid coordinates at the start; and the parameters that the scene declares. Where a
    parameter is not at a key in `free`, the equations are projected again on the same trial basis,
    which needs the mesh. Any other change needs a new model and is refused by its key.
    """

    def __init__(
        self, run: PreparedRun, offline_seconds: float = 0.0, again: Again | None = None,
        file: str = "",
    ) -> None:
        self._file_name = file
        self._run, self._again, self._fixed = run, again, fixed_arrays(run.header)
        self._earlier = 0  # number of steps of its runs so far
        # number of steps and `output.every` -> what checks found in such a run with its own loads
        self._found = dict[tuple[int, int], Findings]()
        self.offline_seconds = offline_seconds
        """Time of its preparation with an empty cache, s; 0 for a model from a file."""

    def __repr__(self) -> str:
        return f"<ReducedModel {self.scene.name}, {self._run.header.reducer}, {self.size} unknowns>"

    def _repr_html_(self) -> str:
        """Main facts of the model, for notebooks."""
        return html_table([
            ["model of", self.scene.name], ["reducer", self._run.header.reducer],
            ["unknowns", ", ".join(f"{b.name} ({b.size})" for b in self._run.solver.layout)],
            ["a run may change", ", ".join([*self.free, *self.scene.parameters])]])

    @property
    def scene(self) -> Scene:
        """Scene from which the model was made."""
        return self._run.scene

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self._run.solver.layout.size

    @property
    def estimates_errors(self) -> bool:
        """True if runs with the model's own loads estimate their error."""
        return bool(self._run.header.estimates)

    @cached_property
    def _extents(self) -> Extents:
        """Sizes of the bodies' displacements and temperatures in the unknowns of the steps."""
        run = self._run
        return run.extents if run.model is None else Extents.from_model(
            run.model, run.solver.layout, run.solver.dictionaries)

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Keys of the scene that a run may change."""
        return (*FREE, *(key for key in self._load_functions if not self._why_fixed(key)))

    @naming_plugins()
    @fixed_threads()
    def run(
        self, overrides: Mapping[str, Any] | Scene | None = None, *, out: str | Path | None = None,
        initial: Initial | None = None, observers: Sequence[object] = (),
        parameters: Mapping[str, float] | None = None,
    ) -> RunResult:
        """Result of a run, equal to that of `simulate`: in memory, or stored under `out`.

        overrides: dotted key -> value, as for `Scene.using`, or the changed scene; initial: block
        of rigid coordinates (`link.rigid`) -> values and rates at the start, which must fit the
        joints; parameters: of the scene, name -> value. Raises InputError, with the key, for a
        change that needs a new model; SolveFailed as `simulate`.
        """
        begun = time.perf_counter()
        changed = overrides or {}
        if parameters:
            scene = changed if isinstance(changed, Scene) else self.scene.using(
                changed, label="run")
            changed = scene.using(values_at(parameters), label="parameters")
        with usable(self._file_name):
            run = self._changed(changed, initial or {})
        manager = new_manager(observers)
        stats, begin = StepStatistics(offline=time.perf_counter() - begun), None
        if run.solver is self._run.solver:
            run = replace(run, extents=self._extents)
            with usable(self._file_name):
                state, memory = self._begin
            begin = state, memory.copy()
        own = None if run.offline is self._run.offline else run.offline  # if projected again
        products = None if own is None else own.products
        earlier, self._earlier = self._earlier, self._earlier + run.steps
        repeated, key = begin is not None, (run.steps, run.scene.output.every)

        def taken(recorder: Recorder) -> RunResult:
            steps = RunSteps(
                run, recorder, manager, stats, begin=begin, earlier=earlier,
                found=self._found.get(key) if repeated else None)
            result = steps.finish(steps.take())
            if repeated and steps.found is not None and steps.control is None:
                self._found[key] = steps.found
            return result

        if out is None:
            with usable(self._file_name):
                writer = MemoryWriter(
                    run.header, self._fixed if own is None else fixed_arrays(run.header))
                return taken(Recorder(run, writer, None, products))
        with owned(Path(out)):
            recorder = Recorder.open(run, Path(out), False, products)
            with kept(recorder.writer, new=True), usable(self._file_name):
                return taken(recorder)

    @naming_plugins()
    @fixed_threads()
    def compile_steps(self, runs: int = RUNS) -> float:
        """Compiles the steps of the model, unless `reducer.compiled` leaves it out for so many runs
        of it; returns the wall time, s, 0 where nothing is compiled. The machine code is kept, and
        later runs of all models of the same kind take it (a model from a file has one of its own,
        which checks every index)."""
        check_count(runs, "runs")
        run, begun = self._run, time.perf_counter()
        h, integrator = run.scene.time.step, run.scene.integrator
        with usable(self._file_name), np.errstate(all="ignore"):
            many = many_steps(run.solver, integrator, h, runs * run.steps)
            if many is None:
                return 0.0
            state, memory = self._begin
            for _ in in_blocks(step_of(run.solver, integrator, h), state, memory.copy(),
                               FIRST_STEPS, many=many):
                pass
        self._earlier = max(self._earlier, runs * run.steps)  # its runs take it from now on
        return time.perf_counter() - begun

    def at(self, parameters: Mapping[str, float], atoms: int | None = None) -> "ReducedModel":
        """The model with other values of its scene's parameters: the equations projected again on
        the same trial basis, or on the first `atoms` atoms of each block. Raises InputError for a
        model from a file, which has no equations to project."""
        if atoms is not None:
            check_count(atoms, "atoms")
        if self._again is None:
            raise InputError("this model was read from a file, without the mesh that it needs to "
                             "project equations again", "parameters")
        scene = self.scene.using(values_at(parameters), label="parameters")
        return ReducedModel(self._again(scene, atoms), self.offline_seconds, self._again)

    def check(self, overrides: Mapping[str, Any] | Scene) -> None:
        """Raises the InputError that a run with these overrides would raise."""
        if faults := self._faults(self._scene_with(overrides)):
            raise InputError(list(faults.values()))

    def save(self, path: str | Path, *, fields: bool = False) -> None:
        """Writes the model to a file. fields: with meshes and bases, so that its results have
        displacements and temperatures of all nodes; without them they have coefficients, rigid
        motion, joint forces and probes.

        Raises InputError for a model that cannot be stored, and, with `fields`, for one that was
        read from a file without them.
        """
        if fields and not self._has_fields:
            raise InputError("this model was read from a file without fields", "fields")
        replace_file(Path(path), self._dump(fields))

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpacked, (self._dump(self._has_fields), None)

    def stepper(
        self, inputs: Sequence[str] = (), outputs: Sequence[str] = ()
    ) -> ModelStepper:
        """Steps from outside: inputs set and outputs read between them.

        inputs: keys of functions of time of loads and joints (`loads.push.factor`,
        `joints.crank.angle`), whose values are set from the first step on; outputs: names, by
        default all (`outputs_of`). Raises InputError for others.
        """
        known = self._inputs
        faults = [
            Fault("inputs", f"no function of time is at {k!r}: {suggestions(k, known, 'inputs')}")
            for k in inputs if k not in known]
        if not faults:
            faults = [Fault("inputs", f"{key} cannot be one: {why}")
                      for key in inputs if (why := self._why_fixed(key))]
        if faults:
            raise InputError(faults)
        run, set_by = self._run, {key: Input(known[key].value(0.0)) for key in inputs}
        if set_by:
            with usable(self._file_name):
                by = _table(self.scene), {**_functions(self.scene), **set_by}
                made, forces = self._packed.made(*by), self._pack(run.forces).made(*by)
                run = replace(run, solver=run.solver.stepping_alike(made), start=self._meshless[1],
                              offline=None, forces=forces)
        return ModelStepper(self, replace(run, extents=self._extents), set_by, outputs)

    @property
    def possible_inputs(self) -> tuple[str, ...]:
        """Keys of functions of time that may be inputs of a stepper."""
        return tuple(key for key in self._inputs if not self._why_fixed(key))

    @property
    def _has_fields(self) -> bool:
        return all(len(d.offset) for d in self._run.header.dictionaries.values())

    def _dump(self, fields: bool) -> bytes:
        """Bytes of the model file. fields: with meshes and dictionaries, so that runs of it have
        fields. Their parts are the fields of the prepared run, without those that are made again
        from the scene or need the mesh."""
        run = self._run
        if self.estimates_errors or run.error_limit.at_few_steps != "off":
            run = _without_estimate(run, NO_MESH)
        solver, start = self._meshless
        header = run.header if fields else replace(
            run.header, bodies={}, dictionaries=self._meshless[0].dictionaries)
        parts = {f.name: getattr(run, f.name) for f in fields_of(run)} | {
            "solver": solver, "start": start, "header": replace(header, scene={}),
            "extents": self._extents.with_few_rows(),
            "model": None, "own_loads": True, "offline": None,
            "full_start": None,
            "given": run.given if fields else {}, "probes": tuple(
                replace(p, place=p.place.without_mesh())
                for p in run.probes)}
        del parts["scene"]
        about = {"scene": run.scene.dump(), "name": run.scene.name}
        return replace(self._pack(parts), about=about).dump()

    # ------------------------------------------------------------------ changes

    @cached_property
    def _load_functions(self) -> Mapping[str, TimeFunction]:
        """Key -> function of time of the loads."""
        return load_functions(self.scene)

    @cached_property
    def _inputs(self) -> Mapping[str, TimeFunction]:
        """Key -> function of time of loads and joints."""
        return dict(functions_of_time({"loads": self.scene.loads, "joints": self.scene.joints}))

    def _pack(self, value: object) -> Packed:
        """Data of an object without plugins. Raises InputError for one that needs the mesh."""
        try:
            return Packed.from_object(value, _table(self.scene), _functions(self.scene))
        except PackedError as error:
            raise InputError(f"a model of reducer {self._run.header.reducer} cannot be kept apart "
                             f"from its mesh here: {error}", "reducer") from None

    @cached_property
    def _meshless(self) -> tuple[Any, State]:
        """The step solver without arrays of the mesh's size, and the state from which it starts.
        Raises InputError for a step solver that cannot do without them."""
        solver = self._run.solver
        if not solver.leaves_mesh:
            raise InputError(f"in this scene the steps of reducer {self._run.header.reducer} need "
                             "the mesh: its model cannot be kept in a file, nor run with other "
                             "loads or from another start", "reducer")
        return solver.without_mesh(), solver.projection(self._run.start)

    @cached_property
    def _begin(self) -> tuple[State, StepMemory]:
        """State and memory of the step solver at the start, with the model's own loads."""
        with np.errstate(all="ignore"):  # overflow ends in a status, not in a warning
            return started(self._run.solver, self.scene.integrator, self._run.start)

    @cached_property
    def _packed(self) -> Packed:
        """The step solver without mesh as data; `used`: keys of the functions of time in it."""
        return self._pack(self._meshless[0])

    def _why_fixed(self, key: str) -> str:
        """Reason why the function of time at `key` cannot change, "" if it can."""
        function, (kind, name) = self._inputs[key], map(str, split(key)[:2])
        if self.scene.rigid_stage is not None and (
                kind == "joints" or self.scene.loads[name].acts_on == "motion"):
            return "it acts on the rigid-body pre-simulation, which the model follows"
        if any(f is function for s in self._run.given.values() for _, f, _ in s.given) or any(
                f is function for p in self._run.probes for _, f in p.place.functions):
            return "it prescribes temperatures, which are no unknowns of the model"
        try:
            return "" if key in self._packed.used else "the model has no such function of time"
        except InputError as error:
            return error.faults[0].message

    def _changed(self, overrides: Mapping[str, Any] | Scene, initial: Initial) -> PreparedRun:
        """The prepared run with other settings. Raises InputError for those that need a new model.

        Parameters: equations projected again (`_again`). Loads or start: step solver made again
        from its data with the functions of time of the new scene, accelerations of its own, and an
        error estimate where that needs no mesh. Anything else: the scene in the header.
        """
        if not (overrides or initial):
            return self._run
        run, scene = self._run, self._scene_with(overrides)
        keys = list(changes(self.scene.dump(), scene.dump()))
        if faults := [*self._faults(scene).values(), *block_faults(initial, run.solver.layout)]:
            raise InputError(faults)
        if self._again is not None and any(self._fault(key, scene) for key in keys):
            again = ReducedModel(self._again(scene, None), again=self._again)
            return again._changed({}, initial)
        checks = Checks.for_scene(scene)
        run = replace(run, scene=scene, header=replace(
            run.header, scene=scene.dump(), scene_digest=scene.digest(),
            steps_planned=step_count(scene)), notes=(
            *(n for n in run.notes if n.kind not in checks.renewed),
            *checks.again(scene, run.model)))
        if initial or any(inside(key, k) for key in keys for k in self._load_functions):
            made = self._packed.made(_table(scene), _functions(scene))
            solver = run.solver.stepping_alike(made)
            start = self._resolved(made, started_from(
                self._meshless[1], initial, run.solver.layout))
            estimator = None if initial else self._estimator_of(scene)
            run = replace(
                run, solver=solver, start=start, own_loads=False, estimator=estimator,
                extents=self._extents, offline=None,
                full_start=None if estimator is None else replace(
                    self._run.start, a=full_state(run.solver, start).a))
            if estimator is None and self.estimates_errors:
                run = _without_estimate(run, "the estimate of these changes needs the mesh")
            if initial:
                notes = start_notes(made, start, initial, run.solver.layout)
                run = replace(run, notes=(*(n for n in run.notes if n.kind != START), *notes))
        if run.estimator is not None and run.steps < run.estimator.every:
            run = _without_estimate(run, f"it has less than {run.estimator.every} steps")
        return run

    def _estimator_of(self, scene: Scene) -> ErrorEstimator | None:
        """The estimator of the model for the loads of a scene; None where there is none, or where
        its terms need the mesh."""
        named, plugins = ({**_functions(s), "integrator": s.integrator}
                          for s in (self.scene, scene))
        try:
            return None if self._run.estimator is None else Packed.from_object(
                self._run.estimator, _table(self.scene), named).made(_table(scene), plugins)
        except PackedError:
            return None

    def _resolved(self, solver: StepSolver, start: State) -> State:
        """The start with the accelerations that the loads of `solver` cause, where a step resolves
        them (`resolved_start`)."""
        if self.scene.rigid_stage is not None:
            return start
        a, h = solver.start(start)[0].a, self.scene.time.step
        # as in `resolved_start`: displacements that a would make in a step, beyond the body
        sizes = self._extents.sizes(0.5 * h * h * a[None])[0]
        far = (size > FAR * b.diagonal for b, size in zip(
            self._extents.blocks, sizes, strict=True) if not b.hot)
        return start if any(far) else replace(start, a=a)

    def _scene_with(self, overrides: Mapping[str, Any] | Scene) -> Scene:
        return overrides if isinstance(overrides, Scene) else self.scene.using(
            overrides, label="run")

    def _faults(self, scene: Scene) -> Mapping[str, Fault]:
        """Key -> fault of the changes that need a new model; none if they are values of parameters
        with which the equations can be projected again."""
        found = {key: f for key in changes(self.scene.dump(), scene.dump())
                 if (f := self._fault(key, scene)) is not None}
        return {} if self._again is not None and all(map(self._declared, found)) else found

    def _fault(self, key: str, scene: Scene) -> Fault | None:
        """Fault of a changed key that the model depends on, None for one that may change."""
        if key == "time.end":
            return self._end_fault(scene)
        if any(inside(key, k) for k in FREE):
            return None
        function = next((k for k in self._load_functions if inside(key, k)), None)
        why = "the model was prepared with it" if function is None else self._why_fixed(function)
        if why and self._declared(key):
            why = f"{why}, and the equations are projected again in a model from memory only"
        return Fault(key, f"cannot change: {why}; make a new model. A run may change "
                     f"{', '.join(self.free)}") if why else None

    def _declared(self, key: str) -> bool:
        """True if a declared parameter is at a changed key of the scene or in it."""
        return any(inside(key, k) or inside(k, key)
                   for p in self.scene.parameters.values() for k in p.keys)

    def _end_fault(self, scene: Scene) -> Fault | None:
        """Fault of another end of the run, None if it may be changed so."""
        if scene.time.control is not None:
            return Fault("time.end", "cannot change: the error control of the steps depends on it")
        prepared = self.scene.time.end
        if scene.rigid_stage is not None and scene.time.end > prepared:
            return Fault("time.end", f"cannot be after {prepared:g} s, where the rigid-body "
                         "pre-simulation ends that the model follows")
        faults = (*endless(scene), *time_faults(scene))
        own = {"time.end", "time.step", *([ESTIMATE] if self.estimates_errors else [])}
        return next((Fault("time.end", f.message) for f in faults if f.key in own), None)


def _functions(scene: Scene) -> Mapping[str, BaseModel]:
    """Dotted key -> function of time, of all in the options of a scene."""
    return dict(functions_of_time(dict(scene)))


def _without_estimate(run: PreparedRun, why: str) -> PreparedRun:
    """The run without an estimate of its error, with a note on that: a warning where the scene asks
    for estimates."""
    note = Note(
        "reducer.error_estimate has no effect in this run of a kept model: the estimate needs the "
        "mesh. Runs of the model in memory with its own start, and its own loads or others where "
        "all terms are linear, have it, and so has `sparsemor run` of the scene", "no_effect"
    ) if run.error_limit.every else information(
        f"the error of this run is not estimated: {why}", "no_estimate")
    return replace(run, notes=(*run.notes, note), estimator=None, header=replace(
        run.header, estimates=(), estimates_every=0))


def _table(scene: Scene) -> Table:
    """Classes and functions of which a model of this scene may be made."""
    found = [*CLASSES, *(c for check in scene.source.registry.every(KIND)
                         for c in check().stored_classes)]
    for _, plugin in nested(dict(scene), Plugin):
        found += plugin.stored_classes
    return table_of(found)
