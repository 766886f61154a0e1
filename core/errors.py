"""Bad input: one or more faults, each with its place, and no traceback for the user."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing wrong with the input. `key` is a dotted path such as `bodies.link1.thickness`."""

    key: str
    message: str


class InputError(ValueError):
    """The scene, or what it refers to, is wrong. Holds every fault found, not just the first.

    Builders raise it with dotted keys relative to what they were given; callers add their own
    prefix with `under`, and the scene loader turns keys into `file:line:column`.
    """

    def __init__(self, faults: Sequence[Fault] | str, key: str = "") -> None:
        self.faults = (Fault(key, faults),) if isinstance(faults, str) else tuple(faults)
        super().__init__("\n".join(f"{f.key}: {f.message}" if f.key else f.message
                                   for f in self.faults))

    def under(self, prefix: str) -> "InputError":
        """The same faults with `prefix.` put before each key."""
        return InputError([Fault(f"{prefix}.{f.key}" if f.key else prefix, f.message)
                           for f in self.faults])


class Damaged(InputError):
    """A stored file that is missing, or no longer what was written; the message has its path."""


class Gather:
    """Tries several things and keeps the faults of those that fail, to raise them together.

        gather = Gather()
        a = gather("a", first, 1.0)
        b = gather("b", second)
        gather.check()
    """

    def __init__(self) -> None:
        self.faults: list[Fault] = []

    def __call__(
        self, key: str, make: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> T | None:
        """Result of `make`, or None when it raised InputError (kept under `key`, if any)."""
        try:
            return make(*args, **kwargs)
        except InputError as error:
            self.faults += (error.under(key) if key else error).faults
            return None

    def check(self) -> None:
        """Raise InputError with all that was kept, if anything was."""
        if self.faults:
            raise InputError(self.faults)
