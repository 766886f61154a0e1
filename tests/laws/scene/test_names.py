"""Names in a scene are labels: other names give the same bases and the same results, bit by bit."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import learnt
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from tiers import quick

PLAIN = {"body": "bar", "joint": "pin", "pull": "pull", "heating": "heating"}
OTHERS = [
    {"body": "bar", "joint": "pin", "pull": "joint", "heating": "inertia"},
    {"body": "thermal", "joint": "elastic", "pull": "joint", "heating": "rigid"},
    {"body": "joint", "joint": "constant", "pull": "multiplier", "heating": "load"},
    {"body": "space", "joint": "load", "pull": "thermal", "heating": "constant"},
]
HALF = {"*.elastic": {"rows": 20, "atoms": 5}, "*.thermal": {"rows": 12, "atoms": 4}}
BASES: dict[str, Any] = {
    "pod": {"use": "pod", "count": 6},
    "modal": {"use": "modal", "count": 6},
    "modal, fixed": {"use": "modal", "count": 6, "interface": "fixed"},
    "craig_bampton": {"use": "craig_bampton", "count": 4},
    "static": {"use": "static"},
}
SETS: dict[str, Any] = {
    name: {"use": "galerkin", "basis": {"use": "pod", "count": 6}, "bases": {"*.elastic": basis}}
    for name, basis in BASES.items()
} | {
    "lspg": {"use": "lspg", "basis": BASES["pod"]},
    "deim": {"use": "deim", "basis": BASES["pod"]},
    "ecsw": {"use": "ecsw", "basis": BASES["pod"]},
    "sparse": {"use": "sparse", "basis": BASES["pod"], "budgets": HALF},
}


def scene(names: dict[str, str]) -> Scene:
    """The heated bar with a surface load that points nowhere in particular."""
    body = names["body"]
    return scene_of({
        "seed": 3, "time": {"end": 0.01, "step": 1e-3}, "integrator": "bdf1",
        "bodies": {body: {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                     "divisions": [8, 2]},
            "sets": {"end_a": {"nearest": [0.0, 0.0]}, "end_b": {"nearest": [0.5, 0.0]}},
            "material": {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 1500, "c": 90},
            "reference": {"chord": ["end_a", "end_b"]}}},
        "joints": {names["joint"]: {"use": "revolute", "between": ["ground", f"{body}:left"]}},
        "loads": {
            "gravity": {"use": "gravity", "g": [0.0, -9.81]},
            names["pull"]: {"use": "traction", "on": [f"{body}:top"], "traction": [3e3, 1e3],
                            "axes": "space"},
            names["heating"]: {"use": "heat_flux", "on": [f"{body}:right"], "flux": 1e6}}})


@cache
def full(which: int) -> March:
    return march(scene(([PLAIN, *OTHERS])[which]).using({"reducer": "full"}))


def reduced(which: int, reducer: Any) -> March:
    names = ([PLAIN, *OTHERS])[which]
    return march(scene(names).using({"reducer": reducer}), model=full(which).model,
                 snapshots=learnt(full(which)))


def atoms(run: March) -> list[FloatArray]:
    return [d.atoms for d in run.solver.dictionaries.values()]


@pytest.mark.full
def test_joint_forces_are_known_by_their_kind() -> None:
    data = [assemble(scene(n)).block_data(f"{n['body']}.elastic") for n in (PLAIN, *OTHERS)]
    for other in data:
        np.testing.assert_array_equal(other.loads, data[0].loads)
        np.testing.assert_array_equal(other.joints, data[0].joints)
    pulled = [i for i, name in enumerate(data[0].load_names) if name.startswith("pull")]
    held = [i for i, name in enumerate(data[0].load_names) if name.startswith("joint pin")]
    assert len(pulled) == 2 and data[0].joints.tolist() == held and len(held) == 2


@pytest.mark.full
@pytest.mark.parametrize("which", range(1, len(OTHERS) + 1))
def test_full_order_does_not_know_names(which: int) -> None:
    np.testing.assert_array_equal(full(which).x, full(0).x)


@pytest.mark.full
@pytest.mark.parametrize("name", quick(SETS, *list(SETS)[::2]))
def test_neither_bases_nor_results_know_names(name: str) -> None:
    plain = reduced(0, SETS[name])
    for which in range(1, len(OTHERS) + 1):
        run = reduced(which, SETS[name])
        for got, want in zip(atoms(run), atoms(plain), strict=True):
            np.testing.assert_array_equal(got, want)
        np.testing.assert_array_equal(run.x, plain.x)


@pytest.mark.parametrize("name", ["bar.thermal", "x.elastic", "bar.rigid", "joint x", "b:left"])
def test_a_name_has_no_room_for_a_field(name: str) -> None:
    with pytest.raises(Exception, match="a name is made of letters, digits and _"):
        scene({**PLAIN, "pull": name})
