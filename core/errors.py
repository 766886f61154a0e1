"""Input errors: one or more faults, each with its location, shown to the user without a
traceback."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from numbers import Integral
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Fault:
    """Single fault of the input. `key` is a dotted path such as `bodies.link1.thickness`."""

    key: str
    message: str


class InputError(ValueError):
    """Error in the scene or in a file that it names; holds every fault found, not just the first.

    Keys are dotted paths relative to the part that is built; callers prepend their own prefix with
    `under`, and the scene loader turns keys into `file:line:column`.
    """

    def __init__(self, faults: Sequence[Fault] | str, key: str = "") -> None:
        self.faults = (Fault(key, faults),) if isinstance(faults, str) else tuple(faults)
        super().__init__("\n".join(f"{f.key}: {f.message}" if f.key else f.message
                                   for f in self.faults))

    def _render_traceback_(self) -> list[str]:
        """What notebooks show: the faults, without the traceback."""
        return [f"{type(self).__name__}: {self}"]

    def under(self, prefix: str) -> "InputError":
        """Error with the same faults, `prefix.` put before each key."""
        return InputError([Fault(f"{prefix}.{f.key}" if f.key else prefix, f.message)
                           for f in self.faults])


class Damaged(InputError):
    """Error for a stored file that is missing or was altered; the message has its path."""


class PluginError(InputError):
    """Error in the code of a plugin: one line with its distribution, the plugin, the method and the
    place in its file. own: True for a plugin of this distribution."""

    own = False


def check_count(value: object, key: str, least: int = 1) -> None:
    """Raises InputError, with the key, unless a value is an integer of at least `least`."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"must be an integer of at least {least} (got {value!r})", key)


class Gather:
    """Collector of faults: calls several functions, or runs several blocks, and raises the errors
    of those that fail together.

        gather = Gather()
        a = gather("a", first, 1.0)
        with gather.under("b"):
            b = second()
        gather.check()
    """

    def __init__(self) -> None:
        self.faults: list[Fault] = []

    def __call__(
        self, key: str, make: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> T | None:
        """Result of `make`, or None when it raised InputError, whose faults are kept under `key`,
        if given."""
        with self.under(key):
            return make(*args, **kwargs)
        return None

    @contextmanager
    def under(self, key: str) -> Iterator[None]:
        """Context that keeps the faults of an InputError in it under `key`, and ends there."""
        try:
            yield
        except InputError as error:
            self.faults += (error.under(key) if key else error).faults

    def check(self) -> None:
        """Raises InputError with all collected faults, if there are any."""
        if self.faults:
            raise InputError(self.faults)
