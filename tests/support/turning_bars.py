"""Bars whose frames turn as given, in the plane and in space."""

from typing import Any

import numpy as np

from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.model.prescribed_quantities import Followed
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of

STEPS, H = 8, 1e-3
STEEL = {"nu": 0.3, "rho": 1100, "alpha": 1e-4, "k": 20, "c": 500}


def bar(E: float, divisions: tuple[int, int, int] = (3, 1, 1), **reducer: Any) -> Scene:
    """A clamped bar with damping, that turns about z and carries its weight."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic", "thermal"], "reference": {"clamp": "left"},
            "mesh": BlockMesh(size=(0.3, 0.1, 0.06), divisions=divisions), "frame": "spinning",
            "material": {**STEEL, "E": E}, "damping": {"mass": 2.0, "stiffness": 1e-5},
            "initial_temperature": "293.15 + 50*x"}},
        "loads": {"weight": {"use": "gravity", "g": [1.0, 2.0, -9.0]}},
        "time": {"end": STEPS * H, "step": H}, "integrator": "bdf1",
        "reducer": {"use": "full", **reducer}})


def plane_bar(E: float, **reducer: Any) -> Scene:
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
            "mesh": Rectangle(size=(0.3, 0.1), divisions=(4, 2)), "thickness": 0.02,
            "material": {**STEEL, "E": E}}},
        "loads": {"weight": {"use": "gravity", "g": [1.0, -9.0]}},
        "time": {"end": STEPS * H, "step": H}, "integrator": "bdf1",
        "reducer": {"use": "full", **reducer}})


def turning(scene: Scene, spin: float, size: int, steps: int = STEPS) -> Model:
    """The model whose bar turns with `spin`, rad/s, and ever faster. size: of its pose."""
    t = H * np.arange(steps + 1)
    pose, rate, acceleration = (np.zeros((len(t), size)) for _ in range(3))
    pose[:, -1], rate[:, -1] = spin * t + 50.0 * t**2, spin + 100.0 * t
    acceleration[:, -1] = 100.0
    history = {"bar": FrameHistory(t, pose, rate, acceleration)}
    return assemble(scene, Followed(Stage(t, history, frozenset(history), {}, {}, {})))
