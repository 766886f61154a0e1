"""Checks of a run, plugins of the kind `check`: notes before its first step, what they see of its
steps, and notes and entries of its summary after the last one."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import getattr_static
from itertools import chain
from typing import Any, ClassVar, TypeAlias

import pluggy

from sparsemor.core.arrays import BoolArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.reducer import OfflineProducts
from sparsemor.core.registry.boundary import guard
from sparsemor.core.registry.hooks import hookspec
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.status import SolveFailed

KIND = "check"
OnStep: TypeAlias = Callable[[int, State, State, Mapping[str, BoolArray]], SolveFailed | None]
"""Look at a step: number of steps done, state before and after it, active atoms of each block ->
the failure with which the run ends here, None to go on."""


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What a check says about a run, before its first step or after its last one.

    summary: entries of the summary of its result; failure: with which it ends nevertheless;
    explained: blocks whose errors the notes explain; general: notes on blocks, which are given
    unless another check explains the block. Before the steps, kept: data by name that are needed
    again after the run, also in the runs of a kept model; changes: block -> largest change (2-norm)
    in training, to which estimated errors are compared.
    """

    notes: Sequence[Note] = ()
    summary: Mapping[str, Any] = field(default_factory=dict)
    failure: SolveFailed | None = None
    explained: frozenset[str] = frozenset()
    general: Mapping[str, Note] = field(default_factory=dict)
    kept: Mapping[str, Any] = field(default_factory=dict)
    changes: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def together(cls, found: Sequence["Findings"]) -> "Findings":
        """What several checks find, in their order."""
        explained = frozenset(chain(*(f.explained for f in found)))
        return cls(
            (*chain(*(f.notes for f in found)),
             *(note for f in found for name, note in f.general.items() if name not in explained)),
            summary=dict(chain(*(f.summary.items() for f in found))),
            failure=next((f.failure for f in found if f.failure is not None), None),
            explained=explained, kept=dict(chain(*(f.kept.items() for f in found))),
            changes=dict(chain(*(f.changes.items() for f in found))))


class Check(Plugin):
    """A look at runs: a plugin of the kind `check` derives from it and overrides what it needs.

    Each run has its own object, which may keep what it sees in private attributes. A run of a kept
    model that repeats an earlier one has what was found in that. order: place
    among all checks, in which notes are told; renewed: kinds of its notes of `on_model` on options
    that a run of a kept model may change, for which it is asked again; stored_classes: classes of
    what it keeps (`Findings.kept`), as a model file may contain them.
    """

    order: ClassVar[int] = 1000
    renewed: ClassVar[frozenset[str]] = frozenset()
    stored_classes: ClassVar[Sequence[type]] = ()

    @hookspec
    def on_model(self, scene: Scene, model: Model | None) -> Sequence[Note]:
        """Notes that need no more than the assembled model, also those of `sparsemor validate`.
        None: the model of a kept one that was read from a file."""
        return ()

    @hookspec
    def on_training(self, scene: Scene, model: Model, offline: OfflineProducts) -> Sequence[Note]:
        """Notes on the training run for a survey of models that takes no steps with them."""
        return ()

    @hookspec
    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        """What is found in a run whose step solver is prepared, for steps of one size. again: a run
        of the same training with other values of parameters, whose findings may be used again.
        Raises InputError for a run that the scene asks to refuse."""
        return Findings()

    @hookspec
    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        """What is called after each step from this state on, None for nothing. Called again where
        the run goes on from an earlier state or with another step solver. whole: True at the first
        step of a run that keeps its model."""
        return None

    @hookspec
    def control(self, run: PreparedRun) -> object | None:
        """What takes the steps of a run instead of its loop, a
        `sparsemor.core.simulation.run_steps.StepControl`; None for a run that needs none. Raises
        InputError where it is asked for and cannot be."""
        return None

    @hookspec
    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """What is found in the stored results of a run, and in its steps."""
        return Findings()


HOOKS = tuple(name for name, member in vars(Check).items() if hasattr(member, "sparsemor_spec"))


class Checks(pluggy.PluginManager):
    """The checks of one run, in their order. A method of `Check` that a class overrides is its
    hook, without a mark."""

    def __init__(self, classes: Iterable[type[Plugin]]) -> None:
        super().__init__("sparsemor")
        self.add_hookspecs(Check)
        self.renewed = frozenset[str]()
        checks = sorted(map(_guarded, classes), key=lambda c: c.order)
        for cls in reversed(checks):  # the last one that is registered is called first
            self.register(_Hooks(cls()))
            self.renewed |= cls.renewed

    @classmethod
    def for_scene(cls, scene: Scene) -> "Checks":
        """The installed checks, for a run of a scene."""
        return cls(scene.source.registry.every(KIND))

    def parse_hookspec_opts(
        self, module_or_class: object, name: str
    ) -> pluggy.HookspecOpts | None:
        return vars(Check)[name].sparsemor_spec if name in HOOKS else None

    def parse_hookimpl_opts(self, plugin: object, name: str) -> pluggy.HookimplOpts:
        return pluggy.HookimplOpts(wrapper=False, hookwrapper=False, optionalhook=False,
                                   tryfirst=False, trylast=False, specname=None)

    def of_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        """Notes that need no step solver: those of the scene, of its parts and of the checks."""
        parts = () if model is None else model.parts.values()
        return (*scene.notes, *(n for p in parts for n in p.notes),
                *chain(*self.hook.on_model(scene=scene, model=model)))

    def again(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        """Notes on the options that a run of a kept model may change."""
        return tuple(n for n in chain(*self.hook.on_model(scene=scene, model=model))
                     if n.kind in self.renewed)

    def of_training(self, scene: Scene, model: Model, offline: OfflineProducts) -> tuple[str, ...]:
        """Sentences on the training run."""
        found = self.hook.on_training(scene=scene, model=model, offline=offline)
        return tuple(n.text for n in chain(*found))

    def before_steps(self, run: PreparedRun, again: PreparedRun | None = None) -> Findings:
        """What all checks find in a run whose step solver is prepared."""
        return Findings.together(self.hook.before_steps(run=run, again=again))

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> list[OnStep]:
        """What is to be called after each step."""
        return list(self.hook.on_start(run=run, state=state, whole=whole))

    def control(self, run: PreparedRun) -> object | None:
        """The first of the controls of the steps."""
        return next(iter(self.hook.control(run=run)), None)

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """What all checks find, together."""
        return Findings.together(self.hook.after_run(run=run, result=result))


class _Hooks:
    """The hooks of one check, as attributes; pluggy looks at all names that `dir` lists."""

    def __init__(self, check: Check) -> None:
        for name in _overridden(type(check)):
            setattr(self, name, getattr(check, name))

    def __dir__(self) -> Iterable[str]:
        return vars(self)


def _overridden(cls: type) -> list[str]:
    """Hooks for which a class of checks has a method other than that of `Check`."""
    return [n for n in HOOKS if getattr_static(cls, n, None) is not vars(Check)[n]]


def _guarded(cls: type[Plugin]) -> type[Check]:
    """A class of checks, each of whose hooks says where it fails. Raises InputError for another
    class."""
    if not issubclass(cls, Check):
        raise InputError(f"check plugin {cls.__module__}:{cls.__qualname__} is no "
                         "sparsemor.core.Check: report it to the authors of that package")
    guard(Check, cls, _overridden(cls))
    return cls
