"""The packaged pendulum on a coarse mesh over a tenth of a second."""

from typing import Any

from sparsemor.core.scene.scene import Scene, load
from sparsemor.plugins.stability.variants import SurveyPlan, variants

SMALL = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
         "time.end": 0.1, "training.end": 0.1, "reducer.basis": {"use": "pod", "count": 24},
         "reducer.bases": {"*.thermal": {"use": "pod", "count": 15}}}


def small(required: bool = True, rows: tuple[int, int] = (30, 20), **changes: Any) -> Scene:
    """Under `sparse` with 15/10 atoms; rows: elastic and thermal; required: those of loads kept."""
    scene = load("double_pendulum", {**SMALL, "reducer.residual": "plain", **changes})
    (variant,) = variants(scene, SurveyPlan(rows=[rows], atoms=[(15, 10)], required=[required]))
    return variant.scene
