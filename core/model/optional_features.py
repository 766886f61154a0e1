"""Optional features of a simulation, and the methods that bodies, joints, contacts or reducers need
to support them.

`FEATURES` lists each option that not all plugins support, with the method of the contract
(core/protocols) that the plugin, or the object that it builds, must then have instead of the
default. A plugin that does not is refused by the command `validate` and before the training run.
"""

from dataclasses import dataclass
from typing import TypeVar

from sparsemor.core.errors import InputError
from sparsemor.core.registry.contracts import origin

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Feature:
    """An optional feature of a simulation and one method that it requires of plugins.

    name: of the feature. option: input key that switches it on. kind: plugins that need the method.
    need: the required capability in words, as an infinitive. method: its name and arguments.
    """

    name: str
    option: str
    kind: str
    need: str
    method: str

    def refusal(self, lacking: object, key: str = "") -> InputError:
        """Error for a plugin, or an object that it has built, without the method."""
        return InputError(
            f"with {self.option}, it has to {self.need}, which {origin(lacking)} cannot: it has no "
            f"{self.method}", key)

    def checked(self, made: T | None, by: object, key: str = "") -> T:
        """What the method of an object returned; InputError if that is None, the default."""
        if made is None:
            raise self.refusal(by, key)
        return made


PROBES = Feature("probes", "probes", "body", "have material points", "probe(name, at)")
PRESCRIBED_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "body", "follow a prescribed motion",
    "with_motion(motion)")
PRESCRIBED_REACTIONS = Feature(
    "rigid pre-simulation", "rigid_stage", "joint",
    "take its reactions as prescribed", "known(reactions)")
CONTACT_ALONG_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "contact",
    "be evaluated along a prescribed motion", "imported(motion)")
SURFACE_LOADS = Feature(
    "rigid pre-simulation", "rigid_stage", "body",
    "take loads on its surface", "surface_loads(equations, loads, times)")

FEATURES = (PROBES, PRESCRIBED_MOTION, PRESCRIBED_REACTIONS,
            CONTACT_ALONG_MOTION, SURFACE_LOADS)
