"""Settings of a scene that do not affect its full-order solution."""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.protocols.time_function import Controller
from sparsemor.core.scene.scene import Scene

IRRELEVANT: Mapping[str, Any] = {
    "title": "", "seed": 0, "check_stability": "warn", "check_trial_space": "warn",
    "check_strains": "warn", "output": {}, "probes": {}, "parameters": {}}
"""Keys of a scene that do not affect its solution, with the value to which they are reset. A new
key of `Scene` belongs here or in `RELEVANT`, which a test checks."""
REDUCTION = frozenset({"reducer", "training"})
"""Keys that affect a reduced model only."""
RELEVANT = frozenset({
    "format", "bodies", "joints", "contacts", "loads", "rigid_stage", "initial", "time",
    "integrator", "linear_solver", "linear_solvers"})
NOT_PHYSICS = (frozenset(IRRELEVANT) | REDUCTION) - {"parameters"}
"""Keys that may change without a new reference solution."""


def physics_of(scene: Scene, label: str) -> Scene:
    """Scene with every irrelevant setting reset, so that all scenes of the same physics have the
    same digest. label: origin of the changed keys in messages."""
    without = {f"training.{key}": None for key in ("parameters", "loads")
               if getattr(scene.training, key) is not None}
    reset = dict(IRRELEVANT)
    if any(isinstance(f, Controller) for f in scene.functions_of_time.values()):
        del reset["probes"]  # sensors
    return scene.using({**reset, **without}, label=label)


def training_physics(scene: Scene, own: Mapping[str, Any] | None = None) -> tuple[Scene, Scene]:
    """Scene of the training run, with its own changes if there are several, and the same with
    every irrelevant setting reset."""
    training = scene.for_training(own)
    return training, physics_of(training, "training")
