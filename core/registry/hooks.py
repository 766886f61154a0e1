"""Events of a run, which observers receive; observers return nothing.

An observer is any object with methods marked by `hookimpl`; each takes the arguments it needs:

    class Prints:
        @hookimpl
        def on_step(self, step, t):
            print(step, t)
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import pluggy

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import StepOutcome
from sparsemor.core.status import Status

_PROJECT = "sparsemor"
hookspec = pluggy.HookspecMarker(_PROJECT)
hookimpl = pluggy.HookimplMarker(_PROJECT)


@dataclass(frozen=True, slots=True, eq=False)
class RunStart:
    """Argument of `on_start`.

    t_start, t_end: s; steps: still to do; phase: "run", or "training" or
    "rigid stage" for a run that comes before it.
    """

    title: str
    reducer: str
    t_start: float
    t_end: float
    steps: int
    phase: str = "run"


class Events:
    """Specification of the events: names and arguments."""

    @hookspec
    def on_start(self, run: RunStart) -> None:
        """Before the first step; a training run and the run itself start separately."""

    @hookspec
    def on_step(self, step: int, t: float, x: FloatArray, outcome: StepOutcome) -> None:
        """After an accepted step. t in s; x (n,) in the step solver's layout, not to be changed."""

    @hookspec
    def on_resample(self, block: str, rows: IntArray) -> None:
        """A block's sampled rows (m,) were chosen: before the first step, and again during the
        run."""

    @hookspec
    def on_support_change(self, t: float, block: str, support: BoolArray) -> None:
        """A block's active atoms (k,) differ from the step before."""

    @hookspec
    def on_failure(self, status: Status, t: float, block: str, detail: str) -> None:
        """The run stops at t (s)."""

    @hookspec
    def on_finish(self, summary: Mapping[str, Any]) -> None:
        """The run ended, well or not; always the last event after `on_start`."""


class ObserverPlugin(Protocol):
    """A plugin that makes observers: objects with methods marked by `hookimpl`."""

    def observer(self) -> object:
        """A new observer for one run and its training run."""
        ...


@runtime_checkable
class Closes(Protocol):
    """Observer with a resource to release at its end, such as the terminal."""

    def close(self) -> None: ...


class Manager(pluggy.PluginManager):
    """One run's observers. Guard costly arguments with `if manager.has_observers`."""

    def __init__(self) -> None:
        super().__init__(_PROJECT)
        self.add_hookspecs(Events)
        self.has_observers = False


def new_manager(observers: Iterable[object] = ()) -> Manager:
    """A manager for one run.

    Raises `InputError` for an observer that listens to nothing, twice, or to an unknown event.
    """
    manager = Manager()
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
