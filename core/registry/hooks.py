"""Events of a run for observers, such as progress displays; observers return nothing.

An observer is any object with methods marked by `hookimpl`; each takes the arguments it needs:

    class Prints:
        @hookimpl
        def on_step(self, step, t):
            print(step, t)
"""

import logging
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import pluggy

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.integrator import StepOutcome
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.status import Status

_PROJECT = "sparsemor"
_log = logging.getLogger(_PROJECT)
hookspec = pluggy.HookspecMarker(_PROJECT)
hookimpl = pluggy.HookimplMarker(_PROJECT)


@dataclass(frozen=True, slots=True, eq=False)
class RunStart:
    """Description of a run at its start, the argument of `on_start`.

    t_start, t_end: s; steps: number of steps to do; phase: "run", or "training" or "rigid stage"
    for a training run or a rigid-body pre-simulation.
    """

    title: str
    reducer: str
    t_start: float
    t_end: float
    steps: int
    phase: str = "run"


class Events:
    """Events of a run: names and arguments."""

    @hookspec
    def on_start(self, run: RunStart) -> None:
        """Called before the first step, separately for a training run and for the main run."""

    @hookspec
    def on_offline(self, product: str) -> None:
        """Called before a product of the offline stage is computed that the cache does not have,
        such as `training`, `basis`, or the `weights` of ECSW."""

    @hookspec
    def on_step(self, step: int, t: float, x: FloatArray, outcome: StepOutcome) -> None:
        """Called after an accepted step. t: s; x (n,): unknowns of the step solver, not to be
        changed."""

    @hookspec
    def on_resample(self, block: str, rows: IntArray) -> None:
        """Called when rows (m,) of a block's equations were sampled: before the first step, and
        after each resampling."""

    @hookspec
    def on_support_change(self, t: float, block: str, support: BoolArray) -> None:
        """Called when the active atoms (trial vectors) of a block change; support (k,): True for
        active ones; t: s."""

    @hookspec
    def on_failure(self, status: Status, t: float, block: str, detail: str) -> None:
        """Called when the run stops at t (s) because a step failed in `block`."""

    @hookspec
    def on_finish(self, summary: Mapping[str, Any]) -> None:
        """Called at the end of the run, successful or not; always the last event after
        `on_start`."""


class Log:
    """Observer that writes the events of a run to the logger `sparsemor`, as information: from
    `logging.getLogger("sparsemor").setLevel("INFO")` on. Handlers are the caller's."""

    @hookimpl
    def on_start(self, run: RunStart) -> None:
        _log.info("%s %s (%s): %d steps from %g to %g s", run.title, run.reducer, run.phase,
                  run.steps, run.t_start, run.t_end)

    @hookimpl
    def on_offline(self, product: str) -> None:
        _log.info("offline: %s", product)

    @hookimpl
    def on_failure(self, status: Status, t: float, block: str, detail: str) -> None:
        _log.error("%s at t = %g s %s %s", status.value, t, block, detail)

    @hookimpl
    def on_finish(self, summary: Mapping[str, Any]) -> None:
        for note in summary.get("notes", ()):
            _log.warning(note)
        _log.info("%s after %s steps", summary.get("status", "ended"), summary.get("steps", "?"))


class Observer(Plugin):
    """Options of an observer, from which `observer` makes an object with methods marked by
    `hookimpl`."""

    @abstractmethod
    def observer(self) -> object:
        """New observer for one run and its training run."""


class Manager(pluggy.PluginManager):
    """Dispatcher of events to the observers of one run. Test `manager.has_observers` before
    computing costly arguments."""

    def __init__(self) -> None:
        super().__init__(_PROJECT)
        self.add_hookspecs(Events)
        self.has_observers = False


def new_manager(observers: Iterable[object] = ()) -> Manager:
    """Event dispatcher for one run.

    Raises `InputError` for an observer without event methods, listed twice, or with an unknown
    event.
    """
    manager = Manager()
    if _log.isEnabledFor(logging.INFO):
        manager.register(Log())
    for observer in observers:
        try:
            manager.register(observer)
            manager.check_pending()
        except (pluggy.PluginValidationError, ValueError) as error:
            raise InputError(f"observer {observer!r}: {error}", "observers") from error
        if not manager.get_hookcallers(observer):
            raise InputError(
                f"observer {observer!r} listens to nothing: mark its methods with "
                "@sparsemor.core.registry.hooks.hookimpl", "observers")
        manager.has_observers = True
    return manager
