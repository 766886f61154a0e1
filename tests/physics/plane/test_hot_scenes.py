"""The packaged scenes with temperature-dependent steel, on coarse meshes and short runs: reduced
models on the load that they were trained on, and on another one."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor import load
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march

pytestmark = pytest.mark.full
SMALL: dict[str, dict[str, Any]] = {
    "hot_plate": {"bodies.plate.mesh.divisions": [20, 4], "time.end": 100.0},
    "hot_pendulum": {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
                     "time.end": 0.06}}


@cache
def scenes(name: str) -> tuple[Scene, Scene]:
    """The scene with the load of its training run, and with its own."""
    own = load(name, SMALL[name])
    return own.using(own.training.overrides), own


@cache
def full(name: str) -> tuple[March, March]:
    trained, own = (march(scene.using({"reducer": "full"})) for scene in scenes(name))
    return trained, own


def errors(run: March, reference: March) -> float:
    """Largest error of a field over its largest change."""
    found = []
    for block in run.model.reducible():
        x, want = decoded(run, block), decoded(reference, block)
        found.append(float(np.abs(x - want).max() / np.abs(want - want[0]).max()))
    return max(found)


@pytest.mark.parametrize("name, reducer", [
    ("hot_plate", "galerkin"), ("hot_plate", "ecsw"), ("hot_pendulum", "deim"),
    ("hot_pendulum", "sparse")])
def test_reduced_models_of_hot_scenes(name: str, reducer: str) -> None:
    snapshots = learnt(full(name)[0])
    own = scenes(name)[1].dump()["reducer"]
    options = {"use": reducer, "basis": own["basis"], "bases": own.get("bases", {})}
    if reducer == "sparse":
        options["sampler"] = "deim"
    seen, unseen = (
        errors(march(scene.using({"reducer": options}), snapshots=snapshots), reference)
        for scene, reference in zip(scenes(name), full(name), strict=True))
    assert seen < 1e-4
    assert unseen < 1e-2


@pytest.mark.parametrize("name", SMALL)
def test_hot_scenes_are_nonlinear(name: str) -> None:
    """With properties of 20 degrees Celsius the fields are others."""
    own = scenes(name)[1]
    cold = {"rho": 7850, "E": 2.1e11, "nu": 0.3, "alpha": 1.216e-5, "k": 53.3, "c": 440}
    constant = march(own.using({f"bodies.{b}.material": cold for b in own.bodies} | {
        "reducer": "full"}))
    assert errors(constant, full(name)[1]) > 1e-2
