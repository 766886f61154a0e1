"""Settings that the full-order solution of a scene does not depend on: the one list of them."""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.scene.scene import Scene

IRRELEVANT: Mapping[str, Any] = {
    "title": "", "seed": 0, "check_stability": "warn", "output": {}, "probes": {}}
"""Keys of a scene, with the value that represents all of them. A new key of `Scene` belongs here
or in `RELEVANT`, which a test checks."""
REDUCTION = frozenset({"reducer", "training"})
"""Keys that only a reduced model depends on."""
RELEVANT = frozenset({
    "format", "bodies", "joints", "contacts", "loads", "rigid_stage", "time", "integrator",
    "linear_solver", "linear_solvers"})
NOT_PHYSICS = frozenset(IRRELEVANT) | REDUCTION
"""Keys that may change without another reference solution."""


def physics_of(scene: Scene, label: str) -> Scene:
    """The scene with every irrelevant setting reset, so that its digest finds what was computed
    for any scene of the same physics. label: of a changed key in messages."""
    return scene.using(IRRELEVANT, label=label)


def training_physics(scene: Scene) -> tuple[Scene, Scene]:
    """The training scene, and the same with every irrelevant setting reset."""
    training = scene.for_training()
    return training, physics_of(training, "training")
