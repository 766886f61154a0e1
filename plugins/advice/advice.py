"""Choice of fields and reducer of a scene by trial runs over its training run, and the explicit
scene that repeats it."""

import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from sparsemor.core import Reducer, State, StepSolver
from sparsemor.core.arrays import Arrays
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.reducer import Choice, TrialRun
from sparsemor.core.registry.hooks import Manager, new_manager
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.scene.html import html_text
from sparsemor.core.scene.option_tree import nested
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.simulation.time_stepping import full_state, problem_of
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.publishing.tables import text_table
from sparsemor.plugins.stability.stability_check import check_run

CHOOSER = "auto"
"""Reducer that chooses another one, with which the trial runs are made."""
CHOSEN, UNMET = "chosen", "tolerance_unmet"
"""Kinds of the notes on a chosen reducer."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Advice:
    """Fields and reducer that trial runs chose for a scene.

    scene: the scene with these, without a reducer that chooses; choice: the trial runs and what
    they show; left_out: names of the blocks that are left out; fields: block -> field; full_ms:
    wall time of a step of the training run, ms; full_seconds, seconds: wall time of the full-order
    training run, its rigid-body pre-simulation included, and of the trial runs, s.
    """

    scene: Scene
    choice: Choice
    left_out: tuple[str, ...]
    fields: Mapping[str, str]
    full_ms: float
    full_seconds: float
    seconds: float

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of a run of the chosen scene."""
        return (information(f"chosen by trial runs: {self.summary}", CHOSEN),
                *(Note(f"the tolerance is not met: {text}", UNMET) for text in self.choice.doubts))

    @property
    def summary(self) -> str:
        """Reducer, numbers of atoms and blocks that are left out, in one line."""
        chosen = self.choice.trials[-1:]
        atoms = [f"{k} atoms of {n}" for t in chosen for n, k in t.atoms.items()]
        gone = [f"without {', '.join(self.left_out)}"] if self.left_out else []
        return ", ".join([str(self.choice.reducer["use"]), *atoms, *gone])

    def save(self, path: str | Path) -> None:
        """Writes the chosen scene to a file. Raises InputError where its relative paths of other
        files would lead elsewhere."""
        target, folder = Path(path), self.scene.file_folder
        reads = any(list(plugin.files(self.scene.folder)) for _, plugin in nested(
            dict(self.scene), Plugin))
        if reads and folder is not None and target.absolute().parent != folder:
            raise InputError(f"the scene reads files next to it: write it to the folder {folder}",
                             "out")
        text = io.StringIO()
        writer = YAML(typ="safe", pure=True)
        writer.default_flow_style, writer.width = None, 100
        writer.representer.sort_base_mapping_type_on_output = False
        writer.dump(_plain(self.scene.source.tree), text)
        replace_file(target, text.getvalue().encode("utf-8"))

    def __str__(self) -> str:
        """Table of the trial runs, the reasons and the chosen reducer."""
        fields = list(dict.fromkeys(self.fields[n] for t in self.choice.trials for n in t.atoms))
        rows = [["method", "atoms", *(f"{f}, {part}" for f in fields for part in
                                      ("held out", "whole")), "elements", "ms/step"]]
        rows.append(["full order", "-", *(["-"] * 2 * len(fields)), "-", f"{self.full_ms:.3g}"])
        for t in self.choice.trials:
            # errors in the part of the training run that trial bases did not use, and in all of it
            cells = [self._worst(e, f) for f in fields for e in (t.holdout, t.errors)]
            rows.append([t.method, "/".join(map(str, t.atoms.values())), *cells, str(t.elements),
                         "-" if t.ms is None else f"{t.ms:.3g}"])
        gone = [f"left out: {', '.join(self.left_out)}, which do not change"] if (
            self.left_out) else []
        return "\n".join([
            text_table(rows), "", *gone, *self.choice.reasons,
            *(f"tolerance not met: {d}" for d in self.choice.doubts),
            f"chosen: {self.summary}",
            f"full-order run {self.full_seconds:.3g} s, trial runs {self.seconds:.3g} s"])

    def __repr__(self) -> str:
        return f"<Advice: {self.summary}>"

    def _repr_html_(self) -> str:
        """Trial runs and reasons, for notebooks."""
        return html_text(str(self))

    def _worst(self, errors: Mapping[str, float], field: str) -> str:
        """Largest error of a field over its blocks, as text."""
        found = [e for n, e in errors.items() if self.fields[n] == field]
        return f"{max(found):.1e}" if found else "-"


@fixed_threads()
def advise(
    scene: Scene, *, tolerance: float | None = None, observers: Sequence[object] = (),
    cache: Cache | None = None, body_cache: BodyCache | None = None, progress: bool = False,
) -> Advice:
    """Fields and reducer for a scene, chosen by trial runs over its training run, the last one of
    several.

    tolerance: largest error of each field, relative to its largest change; by default that of the
    scene's own reducer, if that chooses; progress: show it on standard error. Raises InputError for
    bad input, SolveFailed if the training run fails.
    """
    if not scene.reducer.chooses:
        scene = scene.using({"reducer": CHOOSER})
    if tolerance is not None:
        scene = scene.using({"reducer.tolerance": tolerance}, label="tolerance")
    with progress_bar(progress) as bar:
        manager = new_manager((*observers, *bar))
        return _advice(scene, cache or Cache(), manager, body_cache or BodyCache())


def with_reducer(scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache) -> Scene:
    """The scene with the fields and the reducer that its reducer chooses. Raises as `advise`."""
    advice = _advice(scene, cache, manager, body_cache)
    return advice.scene.with_notes(advice.notes)


@np.errstate(all="ignore")  # overflow ends in a status, not in a warning
def _advice(scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache) -> Advice:
    """Trial runs over the training run of a scene, whose outcome is cached, and the scene with what
    they chose."""
    begun = time.perf_counter()
    chooser = scene.reducer
    training = _training(scene)
    model, offline = prepared(training, cache, manager, body_cache)
    if not model.reducible():
        return _rigid(scene, (), time.perf_counter() - begun)
    if len(scene.training_changes) > 1:
        offline = offline_of(scene, model, offline.products, manager, body_cache)
    offline.train()
    full, ready = offline.products.spent.total, time.perf_counter()
    options = scene.dump()["reducer"]

    def ask() -> Arrays:
        gone, choice = _asked(scene, chooser, model, offline, (cache, manager, body_cache))
        said = {"left_out": gone, "choice": None if choice is None else asdict(choice)}
        return {"advice": np.array(json.dumps(said))}

    found = json.loads(str(offline.remember("advice", (options,), ask)["advice"]))
    gone = tuple(found["left_out"])
    smaller = _without(scene, model, gone)
    if found["choice"] is None:
        return _rigid(smaller, gone, full)
    choice = _choice(found["choice"])
    fields = {n: model.layout.block(n).field for n in model.reducible()}
    # the last three: full-order ms per step, seconds of the training runs and of the trial runs
    return Advice(
        smaller.using({"reducer": choice.reducer}, label=CHOSEN), choice, gone, fields,
        1e3 * full / (scene.training_runs * step_count(training)), full,
        time.perf_counter() - ready)


def _asked(
    scene: Scene, chooser: Reducer, model: Model, offline: Offline,
    tools: tuple[Cache, Manager, BodyCache],
) -> tuple[tuple[str, ...], Choice | None]:
    """Blocks that are left out, and the chosen reducer; None where no block remains. A model
    without the blocks that do not change is taken if the choice for it has no doubts: tolerances
    that are not met. tools: of `prepared`."""
    training = _training(scene)
    problem = problem_of(training, model, offline)

    def choice_for(model: Model, offline: Offline) -> Choice:
        """The chooser's choice for a model; reducers whose model is unstable are rejected."""
        start = resolved_start(model, training.integrator, training.time.step).state

        def unstable(
            reducer: Mapping[str, object], solver: StepSolver, states: Sequence[State]
        ) -> str:
            """Warning of the stability check for a reducer and states of its trial run; "" if it is
            stable."""
            tried = training.using({
                "reducer": reducer, "check_stability": scene.check_stability}, label=CHOSEN)
            if tried.check_stability == "refuse":  # here it rejects a candidate
                tried = tried.using({"check_stability": "warn"}, label=CHOSEN)
            # notes of the check; states of the trial run at which the model is linearised
            return " ".join(n.text for n in check_run(
                tried, model, solver, start, offline,
                [full_state(solver, s) for s in states])[0])

        return chooser.choose(problem_of(training, model, offline), unstable)

    # what does not change in training does not in the run, if training is all of it
    covered = not scene.training.overrides and scene.training_end >= scene.time.end
    gone = chooser.left_out(problem) if covered else ()
    if gone:
        try:
            smaller = prepared(_training(_without(scene, model, gone)), *tools)[0]
            names = smaller.reducible()
            same = all(smaller.layout.block(n).size == model.layout.block(n).size for n in names)
        except (InputError, SolveFailed):  # a load or a joint needs one of these fields
            same, names = False, ()
        if same and not names:
            return gone, None
        if same:
            choice = choice_for(smaller, offline.of_blocks(smaller))
            if not choice.doubts:
                return gone, choice
    return (), choice_for(model, offline)


def _training(scene: Scene) -> Scene:
    """The full-order scene of the training run, the last one of several, with the reducer that
    chooses."""
    training = scene.for_training(scene.training_changes[-1])
    return training.using({"reducer": scene.source.tree["reducer"]}, label="training")


def _without(scene: Scene, model: Model, gone: Sequence[str]) -> Scene:
    """The scene without some blocks, and without loads and joints that act on temperatures alone if
    no temperatures remain."""
    if not gone:
        return scene
    blocks = [model.layout.block(n) for n in model.reducible()]
    dropped: dict[str, set[str]] = {}
    for b in blocks:
        if b.name in gone:
            dropped.setdefault(b.owner, set()).add(b.field)
    overrides: dict[str, Any] = {
        f"bodies.{n}.fields": [f for f in body.selected_fields if f not in dropped[n]]
        for n, body in scene.bodies.items() if n in dropped and body.selected_fields is not None}
    if not any(b.kind.quantity is Quantity.TEMPERATURE for b in blocks if b.name not in gone):
        overrides |= {f"{group}.{n}": None for group, plugins in (
            ("joints", scene.joints), ("loads", scene.loads))
            for n, plugin in plugins.items() if plugin.acts_on == "temperature"}
    return scene.using(overrides, label=CHOSEN)


def _rigid(scene: Scene, gone: tuple[str, ...], seconds: float) -> Advice:
    """Advice for a scene in which no block is left to reduce."""
    choice = Choice({"use": FULL_ORDER}, (), ("no field is left to reduce",))
    return Advice(scene.using({"reducer": FULL_ORDER}, label=CHOSEN), choice, gone, {}, 0.0,
                  seconds, 0.0)


def _choice(data: Mapping[str, Any]) -> Choice:
    return Choice(data["reducer"], tuple(TrialRun(**t) for t in data["trials"]),
                  tuple(data["reasons"]), tuple(data["doubts"]))


def _plain(value: Any) -> Any:
    """Options as plain containers and scalars, for a file."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
