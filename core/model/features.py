"""Optional features of a simulation, and the methods that bodies, joints, contacts or reducers need
to support them.

`FEATURES` lists each option that not all plugins support, with the protocol (core/protocols) that
the plugin, or the object that it builds, must then implement. A plugin that does not is refused by
the command `validate` and before the training run.
"""

from dataclasses import dataclass

from sparsemor.core.errors import InputError
from sparsemor.core.protocols import (
    CarriesSurfaceLoads,
    FollowsMotion,
    HasProbes,
    ImportsMotion,
    PrescribesReactions,
)
from sparsemor.core.registry.contracts import absent_members, origin


@dataclass(frozen=True, slots=True)
class Feature:
    """An optional feature of a simulation and one protocol that it requires of plugins.

    option: input key that switches the feature on. kind: plugins that need the protocol `ability`.
    need: the required capability in words, as an infinitive.
    """

    name: str
    option: str
    kind: str
    ability: type
    need: str

    def refusal(self, lacking: object, key: str = "") -> InputError:
        """Error for a plugin, or an object that it has built, that does not implement the
        protocol."""
        return InputError(
            f"with {self.option}, it has to {self.need}, which {origin(lacking)} cannot: it lacks "
            f"{', '.join(absent_members(self.ability, lacking))} ({self.ability.__name__})", key)


PROBES = Feature("probes", "probes", "body", HasProbes, "have material points")
PRESCRIBED_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "body", FollowsMotion, "follow a prescribed motion")
PRESCRIBED_REACTIONS = Feature(
    "rigid pre-simulation", "rigid_stage", "joint", PrescribesReactions,
    "take its reactions as prescribed")
CONTACT_ALONG_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "contact", ImportsMotion,
    "be evaluated along a prescribed motion")
SURFACE_LOADS = Feature(
    "rigid pre-simulation", "rigid_stage", "body", CarriesSurfaceLoads,
    "take loads on its surface")

FEATURES = (PROBES, PRESCRIBED_MOTION, PRESCRIBED_REACTIONS,
            CONTACT_ALONG_MOTION, SURFACE_LOADS)
