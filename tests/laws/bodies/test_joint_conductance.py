"""Heat through joints: conductance of a joint of two sets, and the note of one that insulates."""

from typing import Any

import numpy as np
import pytest

from reduced_runs import learnt
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.notes import Level
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of

ALUMINIUM = {"E": 7e10, "nu": 0.3, "rho": 2700.0, "alpha": 2e-5, "k": 200.0, "c": 900.0}


def bar(at: float, start: float, order: int = 1) -> dict[str, Any]:
    return {"use": "flexible", "thickness": 0.01, "fields": ["elastic", "thermal"],
            "mesh": {"use": "rectangle", "lower": [0.0, -0.01], "size": [0.1, 0.02],
                     "divisions": [10, 2]},
            "order": order, "material": ALUMINIUM, "reference": {"clamp": "left"},
            "initial_temperature": start, "pose": {"position": [at, 0.0]}}


def welded(joint: dict[str, Any], end: float = 100.0, order: int = 1, **more: Any) -> Scene:
    """Two bars of 343.15 K +- 50 K, welded to each other and to the ground."""
    return scene_of({
        "bodies": {"a": bar(0.0, 393.15, order), "b": bar(0.1, 293.15, order)},
        "joints": {"g": {"use": "fixed", "between": ["ground", "a:left"]},
                   "w": {"use": "fixed", "between": ["a:right", "b:left"], **joint},
                   **more.pop("joints", {})},
        "time": {"end": end, "step": end / 100.0}, "integrator": "bdf1", **more})


def energy(run: March, name: str) -> Any:
    body: Any = run.model.parts[name]
    return run.block(f"{name}.thermal") @ np.asarray(body.heat.capacity.sum(axis=0)).ravel()


def means(run: March) -> tuple[float, float]:
    return tuple(float(run.block(f"{n}.thermal")[-1].mean()) for n in "ab")  # type: ignore


@pytest.mark.full
@pytest.mark.parametrize("order", [1, 2])
def test_two_welded_bars_share_their_heat(order: int) -> None:
    """Equal bars tend to the mean of their temperatures, 343.15 K, and no heat is lost."""
    run = march(welded({"conductance": 50.0}, 1000.0, order))
    assert means(run) == pytest.approx((343.15, 343.15), abs=0.01)
    total = energy(run, "a") + energy(run, "b")
    np.testing.assert_allclose(total, total[0], rtol=4e-12)  # round-off of 100 steps


@pytest.mark.full
def test_a_small_conductance_is_the_resistance_of_the_pair() -> None:
    """Between bars that are nearly uniform: d(T_a - T_b)/dt = -2 G (T_a - T_b) / C."""
    G, C = 0.002, 2700.0 * 900.0 * 0.1 * 0.02 * 0.01
    run = march(welded({"conductance": G}, 100.0))
    left = np.diff(means(run))[0] / -100.0
    assert 1.0 - left == pytest.approx(1.0 - (1.0 + 2.0 * G * 1.0 / C) ** -100, rel=0.01)


@pytest.mark.full
def test_heat_reaches_a_prescribed_temperature_whatever_the_order_of_the_joints() -> None:
    """A bar whose welded end is held at 300 K draws the other one to 300 K."""
    hold = {"use": "prescribed_temperature", "on": ["b:left", "b:right"], "temperature": 300.0}
    last = march(welded({"conductance": 20.0}, 2000.0, joints={"hold": hold}))
    assert last.block("a.thermal")[-1] == pytest.approx(300.0, abs=0.5)
    scene = welded({"conductance": 20.0}, 2000.0)
    swapped = scene.model_copy(update={"joints": {
        **scene_of({"bodies": {"b": bar(0.1, 293.15)}, "joints": {"hold": hold},
                    "time": {"end": 1.0, "step": 1.0}}).joints, **scene.joints}})
    first = march(swapped)
    np.testing.assert_allclose(first.block("a.thermal"), last.block("a.thermal"), rtol=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "sparse"])
def test_reduced_runs_have_the_heat_flow(reducer: str) -> None:
    scene = welded({"conductance": 50.0})
    full = march(scene.using({"reducer": "full"}))
    run = march(scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 8}}}),
                model=full.model, snapshots=learnt(full))
    for name in ("a.thermal", "b.thermal"):
        d = run.solver.dictionaries[name]
        T = d.offset + run.block(name)[-1] @ d.atoms.T
        np.testing.assert_allclose(T, full.block(name)[-1], atol=0.1)


@pytest.mark.full
def test_a_joint_that_insulates_says_so() -> None:
    (note,) = assemble(welded({})).parts["w"].notes  # type: ignore[attr-defined]
    assert note.kind == "insulated_joint" and note.level is Level.INFORMATION
    assert "joints.w between a and b" in note.text
    for joint in ({"conductance": 0.0}, {"conductance": 5.0}):
        assert assemble(welded(joint)).parts["w"].notes == ()  # type: ignore[attr-defined]
    assert assemble(welded({})).parts["g"].notes == ()  # type: ignore[attr-defined]
    same = march(welded({"conductance": 0.0}))
    assert means(same) == pytest.approx((393.15, 293.15), abs=1e-9)


def test_a_side_without_a_temperature_conducts_nothing() -> None:
    cold = welded({})
    for joints, what in (
            ({"g": {"use": "fixed", "between": ["ground", "a:left"], "conductance": 1.0}},
             "the ground has no temperature"),
            ({"w": {"use": "fixed", "between": ["a:right", "b:left"], "conductance": -1.0}},
             "greater than or equal to 0")):
        with pytest.raises(InputError, match=what) as caught:
            assemble(cold.using({f"joints.{k}": v for k, v in joints.items()}))
        assert "conductance" in str(caught.value)
