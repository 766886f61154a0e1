"""Bad input: one or more faults, each with its place, and no traceback for the user."""

from collections.abc import Sequence
from dataclasses import dataclass


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
