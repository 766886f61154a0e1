"""Names carry no physics: renaming bodies, joints, loads and contacts changes no result."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate

GROUPS = ("bodies", "joints", "contacts", "loads")
WORDS = ("joint", "thermal", "elastic", "rigid", "full", "galerkin", "gravity", "multiplier",
         "contact", "load")
"""Names that code which reads names could take for something else."""
PENDULUM = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
            "time.end": 0.01, "training.end": 0.01, "check_stability": "off"}
SLIDER = {"time.end": 1.5e-5, "training.end": 1.5e-5, "check_stability": "off"}
SMALL = {"*.elastic": {"rows": 40, "atoms": 4}, "*.thermal": {"rows": 20, "atoms": 3}}
POD = {"use": "pod", "count": 5}
REDUCERS: Mapping[str, Any] = {
    "full": "full",
    "galerkin": {"use": "galerkin", "basis": {"use": "craig_bampton", "count": 6},
                 "bases": {"*.thermal": {"use": "static"}}},
    "sparse": {"use": "sparse", "basis": POD, "budgets": SMALL},
    "deim": {"use": "deim", "basis": POD},
    "ecsw": {"use": "ecsw", "constant": "weighted", "basis": POD},
}


def renamed(scene: Scene, shift: int) -> tuple[Scene, dict[str, str]]:
    """The scene with other names in the same order, and old name -> new name."""
    tree = scene.source.tree
    old = [name for group in GROUPS for name in tree.get(group, {})]
    names = dict(zip(old, [*WORDS[shift:], *WORDS[:shift]], strict=False))

    def changed(value: Any) -> Any:
        if isinstance(value, str):
            owner, colon, rest = value.partition(":")
            return names.get(owner, owner) + colon + rest
        if isinstance(value, Mapping):
            return {key: v if key == "use" else changed(v) for key, v in value.items()}
        return [changed(v) for v in value] if isinstance(value, list) else value

    made = dict(tree)
    for group in GROUPS:
        made[group] = {names[n]: changed(v) for n, v in tree.get(group, {}).items()}
    made["probes"] = {n: v | {"body": names[v["body"]]} for n, v in tree.get("probes", {}).items()}
    return build(scene.source.of_tree(made)), names


def assert_equal_but_for_names(one: RunResult, other: RunResult, names: Mapping[str, str]) -> None:
    assert [b.size for b in one.layout] == [b.size for b in other.layout]
    for block in one.layout:
        here, there = one.block(block.name), other.block(f"{names[block.owner]}.{block.field}")
        size = float(np.abs(here).max()) or 1.0
        assert np.abs(there - here).max() <= 1e-9 * size, block.name
    for name in one.probes:
        assert np.allclose(other.probe(name), one.probe(name), rtol=1e-9, atol=1e-12), name
    facts = one.summary["facts"], other.summary["facts"]
    there = {f"{names[b.partition('.')[0]]}.{b.partition('.')[2]}" for b in facts[0]}
    assert there == set(facts[1])


@pytest.mark.full
@pytest.mark.parametrize("reducer", REDUCERS)
def test_a_pendulum_by_other_names(reducer: str, tmp_path: Path) -> None:
    scene = load("double_pendulum", PENDULUM | {"reducer": REDUCERS[reducer]})
    other, names = renamed(scene, len(reducer))
    cache = Cache(tmp_path / "cache")
    assert_equal_but_for_names(
        simulate(scene, out=tmp_path / "a", cache=cache),
        simulate(other, out=tmp_path / "b", cache=cache), names)


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["full", "sparse"])
def test_a_slider_by_other_names(reducer: str, tmp_path: Path) -> None:
    scene = load("slider_plate", SLIDER | {"reducer": REDUCERS[reducer]})
    other, names = renamed(scene, len(reducer))
    cache = Cache(tmp_path / "cache")
    assert_equal_but_for_names(
        simulate(scene, out=tmp_path / "a", cache=cache),
        simulate(other, out=tmp_path / "b", cache=cache), names)


@pytest.mark.full
def test_a_load_called_joint_is_no_joint() -> None:
    """It was taken for one by the begin of its name: two more atoms, another error."""
    from sparsemor.core.model.assembly import assemble

    scene = load("double_pendulum", PENDULUM)
    tree = dict(scene.source.tree)
    tree["loads"] = {"joint": tree["loads"]["gravity"], "heating": tree["loads"]["heating"]}
    for made in (scene, build(scene.source.of_tree(tree))):
        data = assemble(made).block_data("link1.elastic")
        joints = [data.load_names[i] for i in data.joints]
        assert len(joints) == 4
        assert not {"joint x", "joint y"} & set(joints)
