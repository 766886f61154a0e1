"""Small scenes that many tests run, read when a test first asks for them."""

from functools import cache
from pathlib import Path

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene, load

SCENES = Path(__file__).parents[1] / "scenes"


@cache
def everything() -> Scene:
    """Every plane joint and load on rigid and flexible bodies (tests/scenes/everything.yaml)."""
    return load(SCENES / "everything.yaml")


@cache
def everything_assembled() -> Model:
    """Its model, which nothing writes to."""
    return assemble(everything())


@cache
def tiny() -> Scene:
    """One heated bar of a few triangles on a hinge (tests/scenes/tiny.yaml)."""
    return load(SCENES / "tiny.yaml")


@cache
def coarse_pendulum() -> Scene:
    """The packaged double pendulum for 0.1 s, 320 triangles a link."""
    return load("double_pendulum", {
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
        "time.end": 0.1, "training.end": 0.1})
