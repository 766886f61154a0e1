"""Features of a scene, and the abilities that they need of its plugins.

Every feature that not all plugins can serve stands in `FEATURES`: the option that asks for it, and
the protocol (core/protocols) that plugins of a kind, or what their `build` returns, must have then.
What lacks it is refused by `validate` and before the training run.
"""

from dataclasses import dataclass

from sparsemor.core.errors import InputError
from sparsemor.core.protocols import (
    CarriesSurfaceLoads,
    FollowsMotion,
    HasProbes,
    ImportsMotion,
    PrescribesReactions,
    RestartsSteps,
)
from sparsemor.core.registry.contracts import absent_members, origin


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature and one ability that it needs.

    option: key of the scene that asks for it. kind: of the plugins that need the ability;
    condition: which of them ("" for all). need: what they have to do, an infinitive.
    """

    name: str
    option: str
    kind: str
    ability: type
    need: str
    condition: str = ""

    def refusal(self, lacking: object, key: str = "") -> InputError:
        """The error for a plugin, or a part that one has built, without the ability."""
        return InputError(
            f"with {self.option}, it has to {self.need}, which {origin(lacking)} cannot: it lacks "
            f"{', '.join(absent_members(self.ability, lacking))} ({self.ability.__name__})", key)


CONTROLLED_STEPS = Feature(
    "error-controlled steps", "time.control", "reducer", RestartsSteps,
    "begin steps at states that it did not compute")
PROBES = Feature("probes", "probes", "body", HasProbes, "have material points", "with a probe")
PRESCRIBED_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "body", FollowsMotion, "follow a prescribed motion")
PRESCRIBED_REACTIONS = Feature(
    "rigid pre-simulation", "rigid_stage", "joint", PrescribesReactions,
    "take its reactions as prescribed", "with multipliers")
CONTACT_ALONG_MOTION = Feature(
    "rigid pre-simulation", "rigid_stage", "contact", ImportsMotion,
    "be evaluated along a prescribed motion")
SURFACE_LOADS = Feature(
    "rigid pre-simulation", "rigid_stage", "body", CarriesSurfaceLoads,
    "take loads on its surface", "touched by a contact")

FEATURES = (CONTROLLED_STEPS, PROBES, PRESCRIBED_MOTION, PRESCRIBED_REACTIONS,
            CONTACT_ALONG_MOTION, SURFACE_LOADS)
