"""A run meshes and integrates each body once: for its check, rigid stage, training and steps."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from sparsemor import load, simulate
from sparsemor.bodies import flexible
from sparsemor.bodies.flexible import Flexible
from sparsemor.core.model.assembly import BodyCache, without_fields
from sparsemor.core.simulation import rigid_stage, training
from sparsemor.core.simulation import validation as checks
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.testing import installed

SCENES = Path(__file__).parents[2] / "scenes"
SHORT = {"time.end": 0.002, "time.step": 0.001, "training.end": 0.002, "check_stability": "off"}


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often bodies were meshed, integrated and put together into models."""
    counts: Counter[str] = Counter()

    def counted(name: str, made: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            counts[name] += 1
            return made(*args, **kwargs)
        return call

    for mesh in installed("mesh").values():
        monkeypatch.setattr(mesh, "build", counted("meshes", mesh.build))
    for name in ("elastic_stiffness", "scalar_mass", "conductivity"):
        monkeypatch.setattr(flexible, name, counted(name, getattr(flexible, name)))
    for module in (checks, training, rigid_stage):
        monkeypatch.setattr(module, "assemble", counted("models", module.assemble))
    return counts


@pytest.mark.full
def test_a_two_stage_run_builds_each_body_once(made: Counter[str], tmp_path: Path) -> None:
    scene = load(SCENES / "small_brake.yaml", {**SHORT, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 2}}})
    simulate(scene, cache=Cache(tmp_path))
    bodies = [p for p in scene.bodies.values() if isinstance(p, Flexible)]
    elastic = sum("elastic" in p.fields for p in bodies)
    heated = sum("thermal" in p.fields for p in bodies)
    assert elastic and heated
    assert made["meshes"] == made["scalar_mass"] == len(bodies)
    assert made["elastic_stiffness"] == elastic
    assert made["conductivity"] == heated
    # the check, the rigid stage, the run, and the run that it is trained on
    assert made["models"] == 4


@pytest.mark.full
def test_other_options_or_another_folder_are_another_body() -> None:
    plugin = load(SCENES / "small_brake.yaml").bodies["disk"]
    body_cache = BodyCache()
    one = body_cache.body(plugin, "disk", Path())
    assert body_cache.body(plugin.model_copy(), "disk", Path()) is one
    assert body_cache.body(plugin, "other", Path()) is not one
    assert body_cache.body(plugin, "disk", SCENES) is not one
    assert body_cache.body(plugin.model_copy(update={"initial_temperature": 400.0}), "disk",
                     Path()) is not one
    rigid_copy = body_cache.body(without_fields(plugin), "disk", Path())
    assert rigid_copy.mesh is one.mesh and rigid_copy.heat is None
    assert without_fields(without_fields(plugin)) is None
