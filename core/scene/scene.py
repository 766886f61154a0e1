"""Scene: bodies, joints, loads, time and method of a run, validated and frozen."""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticSerializationError

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.notes import Note
from sparsemor.core.protocols.body import BodyPlugin
from sparsemor.core.protocols.connector import LoadPlugin
from sparsemor.core.protocols.contact import ContactPlugin
from sparsemor.core.protocols.integrator import Integrator
from sparsemor.core.protocols.joint import JointPlugin
from sparsemor.core.protocols.layout import FieldKind, ordered
from sparsemor.core.protocols.linear_solver import LinearSolver
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.reducer import Reducer
from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.registry.plugin_option import Slot, name_default_slots, slot_default
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.registry.validation_errors import custom, shown, with_advice
from sparsemor.core.scene.default_plugins import FULL_ORDER, HEAT, LARGEST_ERROR, MOTION
from sparsemor.core.scene.html import html_table
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.core.scene.overrides import find
from sparsemor.core.scene.parameters_and_training_points import (
    Parameter,
    number_at,
    parameter_faults,
    training_faults,
    values_at,
)
from sparsemor.core.scene.sections import Initial, Output, Probe, RigidStage, Time, Training
from sparsemor.core.scene.source import Source
from sparsemor.core.scene.varying_loads import LoadTraining

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_OWN = ("probes", "parameters")
"""Groups whose names may be those of another group, too."""
_NAMED = ("bodies", "joints", "contacts", "loads", *_OWN)
LONGEST = 100
"""Largest number of characters of a name."""
RESERVED = "ground"
"""Name of the fixed world in joints."""


def _an_integer(value: object) -> object:
    """Version of the format, unchanged. Raises InputError for true and 1.0, which equal 1 in
    Python."""
    if isinstance(value, bool | float):
        raise InputError(f"the version of the format is the integer 1 (got {shown(value)})")
    return value


class Scene(Plugin):
    """Simulation problem (bodies, joints, loads, time) and the method that solves it.

    Created by `load`, or directly. Keys of its faults are dotted paths of the file; cross
    references (such as the bodies of a joint) are checked when the model is built.
    """

    format: Annotated[Literal[1], BeforeValidator(_an_integer)]
    """Version of the scene format."""
    title: str = ""
    """Title of the scene, for tables and pictures."""
    seed: int = Field(default=0, ge=0)
    """Seed of all random numbers."""
    bodies: dict[str, Annotated[BodyPlugin, Slot("body")]] = Field(min_length=1)
    """Bodies by name."""
    joints: dict[str, Annotated[JointPlugin, Slot("joint")]] = {}
    """Joints between bodies, or between a body and the fixed world, by name."""
    contacts: dict[str, Annotated[ContactPlugin, Slot("contact")]] = {}
    """Contacts by name: pairs of surfaces that may touch."""
    loads: dict[str, Annotated[LoadPlugin, Slot("load")]] = {}
    """Forces and heat that act on bodies, by name."""
    rigid_stage: RigidStage | None = None
    """Rigid-body pre-simulation: a first run with rigid bodies, whose motion, joint forces and
    contact loads are prescribed in the flexible run."""
    initial: Initial | None = None
    """State of a stored result from which the run starts; left out: the state that the bodies'
    options describe."""
    time: Time
    """Time span and step of the run."""
    integrator: Annotated[Integrator, Slot("integrator")] = slot_default(MOTION)
    """Time integrator. Where no body moves or deforms, the default is `bdf2`."""
    linear_solver: Annotated[LinearSolver, Slot("linear_solver")] = slot_default("auto")
    """Linear solver of the large constant matrices of displacements and temperatures, in full-order
    and training runs and in bases that need no training run."""
    linear_solvers: dict[str, Annotated[LinearSolver, Slot("linear_solver")]] = {}
    """Other linear solvers, by pattern of block names (`body.field`), such as `*.thermal`."""
    training: Training = Training()
    """Full-order training run of a reduced model."""
    reducer: Annotated[Reducer, Slot("reducer")] = slot_default(FULL_ORDER)
    """Model order reduction: the solver of one time step."""
    check_stability: Literal["warn", "refuse", "off"] = "warn"
    """Stability check of a reduced model before the run: growth of its time-step map, linearised at
    the start (with integrators of first order at five states of the run). `warn`: report predicted
    instability and continue; `refuse`: raise an error; `off`: skip."""
    check_trial_space: Literal["warn", "refuse", "off"] = "warn"
    """Check, before the run, that the atoms of each reduced block represent its training run, or
    without training an estimate of the run and the static and impulse responses to its loads.
    `warn`: report a projection error above 0.01 and continue; `refuse`: raise an error; `off`:
    skip."""
    check_strains: Literal["warn", "refuse", "off"] = "warn"
    """Check, after the run, that the stress of bodies with linear strains, as of spin, pressure or
    heat, changes their stiffness by less than 5 %, which those leave out; for nonlinear strains,
    that no body is compressed beyond its buckling load. `warn`: report; `refuse`: the run ends with
    status `outside_theory` where linear strains do not hold; `off`: skip."""
    output: Output = Output()
    """Output options."""
    probes: dict[str, Probe] = {}
    """Material points whose motion and temperature are recorded, by name."""
    parameters: dict[str, Parameter] = {}
    """Numbers of the scene with a range, by name: the box over which a reduced model may be trained
    and run."""

    _source: Source | None = PrivateAttr(default=None)
    _notes: tuple[Note, ...] = PrivateAttr(default=())

    @model_validator(mode="wrap")
    @classmethod
    def _all_faults(
        cls, data: Any, validate: ModelWrapValidatorHandler["Scene"]
    ) -> "Scene":
        """Validation that also reports faults across options: names, training span, parameters,
        loads of training. A scene with heat alone gets the integrator of heat."""
        if not isinstance(data, Mapping):
            return validate(data)
        lines, named = name_faults(data), name_default_slots(cls, data)
        try:
            scene = validate(named)
            if "integrator" not in data and all(body.immobile for body in scene.bodies.values()):
                scene = validate({**named, "integrator": HEAT})
        except ValidationError as error:
            lines = with_advice(cls, error) + lines
        else:
            if scene.training_end < scene.time.step:
                message = f"must be at least time.step (got {scene.training_end:g})"
                lines.append(custom("time", message, ("training", "end"), scene.training_end))
            box, faults = scene.training.parameters, parameter_faults(scene.parameters, scene, data)
            wrong = [*faults, *(training_faults(scene.parameters, box) if box else ())]
            lines += [custom("parameters", message, at, None) for at, message in wrong]
            if (loads := scene._load_training) is not None:
                lines += [custom("loads", message, ("training", *at), None)
                          for at, message in loads.faults(scene.training.overrides)]
        if lines:
            raise ValidationError.from_exception_data("Scene", lines)
        return scene

    @property
    def source(self) -> Source:
        """Parsed data from which the scene was made, and their origin."""
        return self._source or Source.of_tree(self.dump())

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on how names of plugins and overrides of the reducer were understood."""
        return self._notes

    @property
    def name(self) -> str:
        """Name of the scene's file without its ending; "scene" when there is no file."""
        return self.source.name

    def _repr_html_(self) -> str:
        """Bodies, joints, contacts and loads as a table, for notebooks."""
        dump = self.dump()
        rows = [["", "name", "kind"]]
        for group in ("bodies", "joints", "contacts", "loads"):
            rows += [[group if i == 0 else "", name, str(entry["use"])]
                     for i, (name, entry) in enumerate(dump.get(group, {}).items())]
        rows.append(["time", "", f"{self.time.end:g} s in steps of {self.time.step:g} s"])
        rows += [[key, "", str(dump[key]["use"])] for key in ("integrator", "reducer")]
        return html_table(rows, f"{self.name}: {self.title}" if self.title else self.name)

    @property
    def file_folder(self) -> Path | None:
        """Folder of the scene's file, None without a file."""
        return None if self._source is None else self._source.folder

    @property
    def folder(self) -> Path:
        """Folder of the scene's file, from which relative paths start; else the working
        directory."""
        return self.file_folder or Path.cwd()

    @property
    def training_end(self) -> float:
        """End of the training run, s."""
        return self.time.end if self.training.end is None else self.training.end

    @property
    def training_runs(self) -> int:
        """Number of training runs, the largest one where it is chosen by errors."""
        box = self.training.parameters
        return max(1 if box is None else box.runs(self.parameters), len(self._load_cases))

    @property
    def training_changes(self) -> list[dict[str, Any]]:
        """Changes of the scene for each training run; {} for one with its own values. Points of
        the box and cases of loads take turns where there are more of the others."""
        box, cases = self.training.parameters, self._load_cases or [{}]
        points = [{}] if box is None else [values_at(p) for p in box.chosen(self.parameters)]
        return [{**points[i % len(points)], **cases[i % len(cases)]}
                for i in range(max(len(points), len(cases)))]

    @property
    def unvaried_loads(self) -> dict[str, float]:
        """Functions of time of `training.loads` that no training run varies, because they have one
        value in this scene, with it."""
        loads = self._load_training
        return {} if loads is None else loads.unvaried()

    @property
    def _load_cases(self) -> list[dict[str, Any]]:
        loads = self._load_training
        return [] if loads is None else loads.cases(self.training_end)

    @property
    def _load_training(self) -> LoadTraining | None:
        varying = self.training.loads
        return None if varying is None else LoadTraining(
            self.loads, varying, self.time.end,
            [key for p in self.parameters.values() for key in p.keys])

    @property
    def point(self) -> dict[str, float]:
        """Values of the parameters in this scene."""
        return {n: value for n, p in self.parameters.items()
                if (value := number_at(self, self.source.tree, p.keys[0])) is not None}

    @property
    def outside_ranges(self) -> dict[str, float]:
        """Parameters whose value in this scene is outside its range, with the value."""
        ranges = {n: p.range for n, p in self.parameters.items()}
        return {n: v for n, v in self.point.items() if not ranges[n][0] <= v <= ranges[n][1]}

    @property
    def functions_of_time(self) -> dict[str, TimeFunction]:
        """Functions of time of loads, joints and contacts, by dotted key."""
        return dict(functions_of_time(
            {"loads": self.loads, "joints": self.joints, "contacts": self.contacts}))

    @property
    def reducer_name(self) -> str:
        """Name of the reducer's plugin."""
        return self.source.registry.name_of("reducer", type(self.reducer))

    @property
    def field_kinds(self) -> tuple[FieldKind, ...]:
        """Kinds of field (such as elastic, thermal) that the bodies may have, in the order of
        blocks and tables."""
        return ordered(k for body in self.bodies.values() for k in body.field_kinds)

    def using(self, overrides: Mapping[str, Any], *, label: str = "--set") -> "Scene":
        """Scene with changes, validated again: `{"reducer.sampler.use": "random"}`.

        A change acts on the data as written: a subtree is replaced as a whole, and a new `use`
        (name of a plugin) drops the options of the plugin that was there. The name of a reducer
        alone keeps the options that both reducers share, and an option that the reducer lacks and
        `sparse` has changes it to `sparse`. label: name of the changes in messages. Raises
        `InputError`.
        """
        return build(self.source.changed(overrides, label))

    def with_reducer(self, reducer: Reducer | Plugin, *, label: str = "--set") -> "Scene":
        """Scene with another reducer, an instance of a registered plugin, and its options."""
        registry = self.source.registry
        assert isinstance(reducer, Plugin)
        options = reducer.model_dump(mode="json", context={"registry": registry})
        name = registry.name_of("reducer", type(reducer))
        return self.using({"reducer": {"use": name, **options}}, label=label)

    def with_notes(self, notes: Iterable[Note]) -> "Scene":
        """The same scene with more notes, which its runs report."""
        scene = build(self.source)
        scene._notes = (*scene._notes, *notes)
        return scene

    def for_training(self, point: Mapping[str, Any] | None = None) -> "Scene":
        """Full-order scene of the training run of a reduced model; point: its changes, if there
        are several runs (`training_changes`).

        It does not depend on the reducer, so its digest shows whether snapshots can be reused.
        """
        scenes: dict[object, Scene] = self.__dict__.setdefault("_for_training", {})  # no field
        key = repr(sorted((point or {}).items()))
        if key not in scenes:
            changes = {**self.training.overrides, **(point or {}),
                       "reducer": {"use": FULL_ORDER, "remaining": LARGEST_ERROR},
                       "training": {"every": self.training.every}}
            changes.setdefault("time.end", self.training_end)
            scenes[key] = build(self.source.changed(changes, "training.overrides"))
        return scenes[key]

    def locate(self, error: InputError) -> list[str]:
        """Messages, one line per fault, `file:line:column: key: message`, in the file's order."""
        return self.source.lines(error)

    def dump(self) -> dict[str, Any]:
        """Scene as plain data for JSON, from which it can be made again."""
        registry = self._source.registry if self._source else Registry()
        try:
            return self.model_dump(mode="json", context={"registry": registry})
        except PydanticSerializationError as error:
            raise InputError(str(error).partition("InputError: ")[2] or str(error)) from None

    def digest(self, *keys: str) -> str:
        """SHA-256 digest of the canonical JSON of the subtrees at dotted `keys`, or of the whole
        scene."""
        tree = self.dump()
        chosen = {key: _subtree(tree, key) for key in keys} if keys else tree
        text = json.dumps(chosen, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()


def load(
    scene: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | None = None, *,
    registry: Registry | None = None,
) -> Scene:
    """Scene from the name of a packaged scene, the path of a file or the contents of one as plain
    data (its paths start from the working directory), with changes as in `Scene.using`.

    Raises `LocatedError`, an `InputError` that holds all faults, each with its line and column.
    """
    plugins = registry or Registry()
    source = Source.of_tree({"format": 1, **scene}, plugins) if isinstance(scene, Mapping) else (
        Source.read(scene, plugins))
    source = source.changed(overrides, "--set") if overrides else source
    built = build(source)
    written = [Fault(key, f"parameter {n} is {v:g} here, outside its range "
                     f"{built.parameters[n].range}") for n, v in built.outside_ranges.items()
               if source.origin(key := built.parameters[n].keys[0]) is None]
    if written:  # a value that a run sets may leave the range, with a warning
        raise source.locate(written)
    return built


def build(source: Source) -> Scene:
    """Scene from a source, validated. Raises `LocatedError` with every fault found."""
    notes: list[Note] = []
    try:
        scene = Scene.model_validate(source.tree, context={**source.context, "notes": notes})
    except ValidationError as error:
        raise source.invalid(error) from None
    scene._source, scene._notes = source, tuple(dict.fromkeys((*source.notes, *notes)))
    return scene


def _subtree(tree: object, key: str) -> object:
    for part in find(tree, key):
        if isinstance(tree, Mapping) and part in tree:
            tree = tree[str(part)]
        elif isinstance(tree, list) and isinstance(part, int) and part < len(tree):
            tree = tree[part]
        else:
            raise InputError([Fault(key, "there is no such key in the scene")])
    return tree


def name_faults(data: Mapping[str, Any]) -> list[InitErrorDetails]:
    """Faults of all names that break a rule, and of probes of bodies that do not exist."""
    owners: dict[object, str] = {}
    lines: list[InitErrorDetails] = []
    groups = {g: data[g] for g in _NAMED if isinstance(data.get(g), Mapping)}
    for group, entries in groups.items():
        for name in entries:
            complaint = _complaint(group, name, owners)
            if complaint:
                lines.append(custom("name", complaint, (group, str(name)), name))
    bodies = sorted(map(str, groups.get("bodies", {})))
    for name, probe in groups.get("probes", {}).items():
        body = probe.get("body") if isinstance(probe, Mapping) else None
        if isinstance(body, str) and body not in bodies:
            message = f"no body is called {body!r}: {suggestions(body, bodies, 'bodies')}"
            lines.append(custom("name", message, ("probes", str(name), "body"), body))
    return lines


def _complaint(group: str, name: object, owners: dict[object, str]) -> str:
    """Fault of a name of a group of the scene, "" if there is none. owners: names so far -> their
    group."""
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        return f"a name is made of letters, digits and _, and starts with no digit (got {name})"
    if len(name) > LONGEST:  # files of the result are called by it
        return f"a name has at most {LONGEST} characters (this one has {len(name)})"
    if name == RESERVED:
        return f"{RESERVED} means the fixed world: choose another name"
    if group in _OWN:
        return ""
    if name in owners:
        return (f"this name is taken in {owners[name]}: bodies, joints, contacts and loads share "
                "their names")
    owners[name] = group
    return ""
