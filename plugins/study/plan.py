"""Plan of a study: all runs as validated scenes, the references and offline products they share,
and faults."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sparsemor.core import FieldKind
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.protocols.layout import ordered
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.overrides import split
from sparsemor.core.scene.run_identity import (
    NOT_PHYSICS,
    Identity,
    environment,
    folder_digest,
    training_physics,
)
from sparsemor.core.scene.scene import Scene, build, load
from sparsemor.core.scene.source import Source, packaged
from sparsemor.core.scene.yaml_reader import KeyPath, LocatedError
from sparsemor.plugins.kept_models.changeable_options import kept_options
from sparsemor.plugins.study.axes import (
    Point,
    axis_columns,
    chart_columns,
    points_of,
    setting_columns,
    taken_names,
)
from sparsemor.plugins.study.jobs import scene_data
from sparsemor.plugins.study.study_file import Study, StudyFault
from sparsemor.plugins.study.table_columns import OUTCOME, RESERVED, columns_of, error_columns

OF_CHARTS = ("title", "method", "budget")
"""Keys of a study file that do not change its table."""


SceneData = Mapping[str, Any]
"""Scene as plain data (`jobs.scene_data`), from which another process can build it."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One run of a study. settings: column -> value; reference, training, products: keys of the
    reference run, training run and bases that it shares with other runs ("" for none); model: key
    of the prepared model that it may share; learns: True if it needs a training run; is_reference:
    True if the run is its own reference; refused: reason why its scene is invalid, "" if it is
    valid.

    name: of a run of a plan that was made without a study file: of its folder, where an interrupted
    one continues; after: names of runs that must have ended first; offered: True if the cache keeps
    its snapshots and, at full order, the run as the reference of other studies.
    """

    number: int
    settings: Mapping[str, Any]
    reducer: str = ""
    seed: int | None = None
    scene: SceneData | None = None
    reference: str = ""
    is_reference: bool = False
    training: str = ""
    products: str = ""
    model: str = ""
    learns: bool = False
    refused: str = ""
    name: str = ""
    after: tuple[str, ...] = ()
    offered: bool = False

    @property
    def label(self) -> str:
        """Name of its job and folder."""
        return self.name or str(self.number)


@dataclass(frozen=True, slots=True)
class Drawing:
    """What the charts of a study need in addition to its rows; it is stored with them.

    name: of the study; lines, budget: columns that distinguish the lines of the chart, and the one
    along it; fields: kinds of fields that the bodies may have; errors_from: start of the time span
    of the errors that are drawn, s, 0 for the whole run; trained_to: end of the training runs, s, 0
    where there is none within the runs, or several; elsewhere: they have other loads; over_time:
    errors over time are drawn; reference_step: time step of the only reference, s, 0 if there are
    several.
    """

    name: str
    lines: tuple[str, ...]
    budget: str
    fields: tuple[FieldKind, ...]
    errors_from: float = 0.0
    trained_to: float = 0.0
    over_time: bool = False
    reference_step: float = 0.0
    elsewhere: bool = False

    def plain(self) -> dict[str, Any]:
        """Plain data from which `of_plain` restores the drawing."""
        return {key: getattr(self, key) for key in self.__dataclass_fields__} | {
            "fields": [kind.plain() for kind in self.fields]}

    @classmethod
    def of_plain(cls, data: Mapping[str, Any]) -> "Drawing":
        return cls(**{**data, "lines": tuple(data["lines"]),
                      "fields": tuple(map(FieldKind.of_plain, data["fields"]))})


@dataclass(frozen=True, slots=True, eq=False)
class StudyPlan:
    """All runs of a study, and key -> scene of the references they are compared with.

    columns: of the table; settings: columns of the changed options; axes: those without the details
    of named alternatives; digest: of everything that determines the results; drawing: of the
    charts.
    """

    study: Study
    runs: tuple[Run, ...]
    references: Mapping[str, SceneData]
    columns: tuple[str, ...]
    settings: tuple[str, ...]
    axes: tuple[str, ...]
    digest: str
    drawing: Drawing

    @classmethod
    def read(
        cls, study: str | Path | Mapping[str, Any], registry: Registry | None = None,
        scene: str | Path | Mapping[str, Any] | None = None,
        overrides: Mapping[str, Any] | None = None,
    ) -> "StudyPlan":
        """Plan of a study file or packaged study, or of its contents. scene: that it varies,
        instead of its own; overrides: changes to that scene. Raises `LocatedError` with every
        fault; nothing is written or run.

        A value that is invalid in every run is a fault of the file; a value that is invalid only in
        some combinations makes these runs refused, and so does one that the study derived from the
        scene.
        """
        plugins = registry or Registry()
        read = Study.read(study, plugins, _named_scene(scene, overrides, plugins))
        points = points_of(read)
        maker = _RunBuilder(read, _scene_of(read, plugins))
        runs = [maker.run(number, point) for number, point in enumerate(points, 1)]
        if not read.derived:
            read.check(maker.never_valid(points))
        maker.check_scene(len(points))
        settings = setting_columns(points)
        fields = ordered(maker.fields)
        file = read.file
        columns = columns_of(settings, fields, file.errors_from > 0.0, file.over_time,
                             file.quantities, file.compared, file.keep)
        # no axis and no quantity may have the name of a column of the results
        read.check(taken_names(file, (*error_columns(fields), *file.quantities)))
        read.check(file.quantity_faults(maker.base.tree, {
            *settings, *RESERVED, *OUTCOME, "seed", *error_columns(fields)}))
        # what the rows depend on, all keys but those that charts alone read: a folder with another
        # digest contains another study
        about = digest(
            {k: v for k, v in read.source.tree.items() if k not in OF_CHARTS},
            environment(), folder_digest(Path(__file__).parent), maker.identities,
            [[r.refused, r.scene["tree"] if r.scene else None] for r in runs],
            {key: s["tree"] for key, s in maker.references.items()})
        steps = {s["tree"]["time"]["step"] for s in maker.references.values()}
        drawing = Drawing(
            read.name, tuple(chart_columns(file, points)), file.budget, fields, file.errors_from,
            maker.trained.pop() if len(maker.trained) == 1 else 0.0, file.over_time,
            steps.pop() if len(steps) == 1 else 0.0, maker.elsewhere)
        return cls(read, tuple(runs), maker.references, tuple(columns), tuple(settings),
                   tuple(axis_columns(points)), about, drawing)

    def only(self, rows: Sequence[Mapping[str, Any]]) -> "StudyPlan":
        """Plan of the runs whose settings contain one of these: column -> value."""
        kept = tuple(run for run in self.runs if any(
            all(run.settings.get(k) == v for k, v in row.items()) for row in rows))
        return replace(self, runs=kept, digest=digest(self.digest, [r.number for r in kept]))


@dataclass(slots=True)
class _RunBuilder:
    """Builder of the runs of a study: collects the faults with their positions and builds each
    reference once."""

    study: Study
    base: Source
    references: dict[str, SceneData] = field(default_factory=dict)
    blamed: dict[int, list[StudyFault]] = field(default_factory=dict)
    scene_lines: dict[int, list[str]] = field(default_factory=dict)
    identities: dict[str, Any] = field(default_factory=dict)
    fields: list[FieldKind] = field(default_factory=list)
    trained: set[float] = field(default_factory=set)
    elsewhere: bool = False
    _known: dict[str, Any] = field(default_factory=dict)

    def run(self, number: int, point: Point) -> Run:
        """Run of one point of the axes; refused, with the reason, if its scene or that of its
        reference is invalid.

        Also collects for the plan: kinds of fields, versions of code and input files
        (`identities`), and ends of training runs within the run (`trained`); `elsewhere` if
        training has other loads or parameters.
        """
        settings, changes = point.settings, point.changes
        source = self.base
        try:
            source = self.base.changed(changes, "run")
            scene = build(source)
            self.fields += scene.field_kinds
            dump = scene.dump()
            identity = Identity.from_scene(scene)
            self.identities |= {"files": {**self.identities.get("files", {}), **identity.files},
                                "plugins": {**self.identities.get("plugins", {}),
                                            **identity.plugins}}
            reference = self._once("reference", self._followed(changes), lambda: self._reference(
                number, point)) if self.study.file.compared else ("", {})
        except InputError as error:
            return Run(number, settings, refused=self._blame(number, error, source, point.owners))
        if isinstance(reference, str):
            return Run(number, settings, refused=reference)
        key, reference_dump = reference
        physics = {k: v for k, v in changes.items()
                   if split(k)[0] not in NOT_PHYSICS - {"training"}}
        training = self._once("training", physics, lambda: _training_key(scene))
        reducer = scene.reducer
        bases, learns, model = [], False, ""
        chosen = reducer.trial_bases()
        if chosen is not None:
            bases = [chosen.shared, dict(chosen.others)]
            learns = any(b.needs_snapshots for b in (chosen.shared, *chosen.others.values()))
            boxed = learns and scene.training.parameters is not None
            model = digest(kept_options(scene, boxed), training if learns else "")
            within = scene.training_end < scene.time.end * (1 - 1e-9)
            other = bool(scene.training.overrides) or scene.training.several
            self.elsewhere |= learns and other
            if learns and within and not other:
                self.trained.add(scene.training_end)
        else:
            training = ""
        # its own reference: full order, with the same options on which the unknowns depend
        own = bool(key) and reducer.full_order and (
            _compared(dump) == _compared(reference_dump))
        return Run(number, settings, scene.reducer_name, scene.seed, scene_data(scene), key,
                   own, training, digest(training, bases) if training else "", model, learns)

    def _followed(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Changes of a run that also apply to its reference."""
        if self.study.file.fixed:
            return {}
        return {k: v for k, v in changes.items() if split(k)[0] not in NOT_PHYSICS}

    def _reference(self, number: int, point: Point) -> tuple[str, dict[str, Any]] | str:
        """(key, scene as plain data) of a run's reference, or the reason why its scene is invalid.
        The reference has the changes of the run that alter the physics (`_followed`), then those
        that the study prescribes for references; faults are located at either."""
        owners = point.owners | {
            k: self._reference_place(k) for k in self.study.file.reference_changes}
        source = self.base
        try:
            source = self.base.changed(self._followed(point.changes), "run")
            source = source.changed(self.study.file.reference_changes, "reference")
            scene = build(source)
        except InputError as error:
            return "reference: " + self._blame(number, error, source, owners)
        key = scene.digest()[:16]
        self.references[key] = scene_data(scene)
        return key, scene.dump()

    def _reference_place(self, key: str) -> KeyPath:
        written = self.study.source.document.positions
        inner: KeyPath = ("reference", "fixed", key)
        return inner if inner in written else ("reference", key)

    def _once(self, kind: str, changes: Mapping[str, Any], make: Callable[[], Any]) -> Any:
        key = kind + json.dumps(changes, sort_keys=True)
        if key in self._known:
            return self._known[key]
        made = make()
        if isinstance(made, tuple) or kind != "reference":  # each run reports its own failure
            self._known[key] = made
        return made

    def _blame(
        self, number: int, error: InputError, source: Source, owners: Mapping[str, KeyPath]
    ) -> str:
        """Records the positions in the study file that cause the faults of a run; returns the
        faults as text. source: scene of the run, which knows which changes made each of its keys;
        owners: changed key -> its position in the study file."""
        words = []
        for fault in error.faults:
            # label: set of changes (such as `set`, `run`, `reference`) that made the faulty value,
            # "" where the scene file did; option: the key as it is written in that set
            label, option = source.origin(fault.key) or ("", "")
            if not label and fault.key in owners:  # it could not even be applied
                label, option = "run", fault.key
            inner = f"{fault.key}: " if fault.key else ""
            words.append(inner + fault.message)
            if label == "set":
                path: KeyPath = ("set", option)
            elif label in ("run", "reference"):
                path = owners[option]
            else:
                self.scene_lines.setdefault(number, []).extend(source.lines(InputError([fault])))
                continue
            prefix = "" if path[-1] == fault.key else inner
            self.blamed.setdefault(number, []).append(StudyFault(path, prefix + fault.message))
        return "; ".join(words)

    def never_valid(self, points: list[Point]) -> list[StudyFault]:
        """Faults of axis values that are invalid in every run that uses them. blamed: number of a
        run -> its faults, located in the study file."""
        found: dict[KeyPath, list[StudyFault]] = {}  # position of an axis value, () for none
        for n, findings in self.blamed.items():
            for f in findings:
                choice = next((p for p in points[n - 1].places if f.path[:len(p)] == p), ())
                found.setdefault(choice, []).append(f)
        never_valid = []
        for choice, findings in found.items():
            takers = [n for n, p in enumerate(points, 1) if not choice or choice in p.places]
            if all(any(f in self.blamed.get(n, ()) for f in findings) for n in takers):
                never_valid += findings
        return never_valid

    def check_scene(self, count: int) -> None:
        """Raises the faults of the scene file itself if all runs have them."""
        runs = len(self.scene_lines)
        if runs and runs == count:
            lines = list(dict.fromkeys(x for found in self.scene_lines.values() for x in found))
            raise LocatedError([Fault("", line) for line in lines], lines)


def _training_key(scene: Scene) -> str:
    """Digest of all data that determine the training run of a scene; "" if it has none."""
    box = scene.training.parameters
    try:
        first, *others = scene.training_changes
        training, physics = training_physics(scene, first)
    except InputError:
        return ""  # the run will say what is wrong
    return digest(physics.digest(), training.training.every, box, dict(scene.parameters), others)


def _compared(dump: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a full-order scene on which its unknowns depend."""
    return {k: v for k, v in dump.items() if k not in NOT_PHYSICS} | {
        "reducer": dump["reducer"], "output": dump["output"]}


def _named_scene(
    scene: str | Path | Mapping[str, Any] | None, overrides: Mapping[str, Any] | None,
    registry: Registry,
) -> Source | None:
    """Scene that was named with the command, with its changes."""
    if scene is None:
        if overrides:
            raise InputError("changes a scene that is named with the command: name one, or write "
                             "the changes under `set` in the study file", "set")
        return None
    return load(scene, overrides, registry=registry).source


def _scene_of(study: Study, registry: Registry) -> Source:
    """Scene of the study with the changes under `set` applied; faults are located at the study's
    keys."""
    if study.scene is not None:
        return _changed(study, study.scene)
    named = study.file.scene
    if not named:
        raise study.locate([StudyFault(("scene",), "is missing: name a scene here, or with the "
                                       "command, `sparsemor study STUDY SCENE`")])
    neighbour = Path(study.source.document.name).parent / named
    if registry.has("scene", named):
        try:
            registry.load("scene", named)
        except InputError as error:  # two packages offer it
            raise study.locate([StudyFault(("scene",), str(error))]) from None
    elif not neighbour.is_file():
        raise study.locate([StudyFault(
            ("scene",), f"there is no such file next to the study, and no packaged scene is "
            f"called {named!r}: {suggestions(named, packaged(registry, 'scene'), 'packaged')}")])
    return _changed(study, Source.read(
        named if registry.has("scene", named) else neighbour, registry))


def _changed(study: Study, source: Source) -> Source:
    try:
        return source.changed(study.file.changes, "set")
    except InputError as error:
        raise study.locate([StudyFault(("set", f.key), f.message) for f in error.faults]) from None
