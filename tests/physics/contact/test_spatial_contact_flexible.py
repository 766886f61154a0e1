"""Contact on deformed surfaces in space inside the step, at full order and reduced."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from sparsemor.core.arrays import FloatArray
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.step.coupled_reduced import ReducedGeneral

PRESSURE, MU, SPEED, STEP = 1e6, 0.3, 0.5, 1e-4
MATERIAL = {"E": 2e9, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 150, "c": 900}


def draw(share: float) -> dict[str, Any]:
    return {"use": "ramp", "end": 1.0, "final": share * SPEED}


def scene(steps: int = 12, reducer: Any = "full", **heat: Any) -> Scene:
    """A pressed block slides over a plate, along a direction that is none of the meshes'."""
    body = {"use": "flexible", "material": MATERIAL, "fields": ["elastic", "thermal"],
            "reference_temperature": 0.0}
    velocity = [0.8 * SPEED, 0.6 * SPEED, 0.0]
    return scene_of({
        "bodies": {
            "block": {**body, "mesh": {"use": "block", "size": [0.02, 0.02, 0.01],
                                       "divisions": [2, 2, 2]},
                      "reference": {"clamp": "top"}, "frame": "spinning",
                      "pose": {"velocity": velocity, "position": [0.0, 0.0, -1e-6]}},
            "plate": {**body, "mesh": {"use": "block", "lower": [-0.01, -0.01, -0.01],
                                       "size": [0.04, 0.04, 0.01], "divisions": [3, 3, 2]},
                      "reference": {"clamp": "bottom"}, "frame": "fixed"}},
        "joints": {"upright": {"use": "prescribed_motion", "of": "block:top", "axis": [0, 0, 1],
                               "angle": 0.0, "x": draw(0.8), "y": draw(0.6)}},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "plate:top"], "surfaces": "deformed",
            "tolerance": 1e-3, "heat": {"share": 0.5, **heat},
            "normal": {"use": "elastic_foundation", "stiffness": 1e12, "damping": 1e6,
                       "damping_depth": 1e-7},
            "friction": {"use": "coulomb", "coefficient": MU, "critical_velocity": 0.01}}},
        "loads": {"press": {"use": "pressure", "on": ["block:top"], "pressure": PRESSURE}},
        "time": {"end": steps * STEP, "step": STEP}, "integrator": "bdf1",
        "reducer": reducer})


@cache
def full() -> March:
    return march(scene())


def forces(run: March) -> FloatArray:
    """(n,) what the contact adds to the forces and heats of all unknowns at the end."""
    term, end = run.model.separated.other[0], run.end
    j, out = term.columns, np.zeros(run.model.layout.size)
    out[term.rows] = -term.residual(end.x[j], end.v[j], end.a[j], end.t)
    return out


@pytest.mark.full
def test_the_contact_carries_the_load_and_drags_against_the_slip() -> None:
    run = full()
    f = forces(run)
    x, y, z, _ = f[run.model.layout["block.rigid"]]
    load = PRESSURE * 0.02**2
    assert z == pytest.approx(load, rel=0.2)  # it still swings on its own elasticity
    drag = np.hypot(x, y)
    # pressure acts along the deformed facets' normals, which lean by the depth over their size
    assert drag == pytest.approx(MU * z, rel=0.01)
    assert y / x == pytest.approx(0.75, rel=0.05)
    plate = np.zeros(3)
    body: Any = run.model.parts["plate"]
    np.add.at(plate, body.elasticity.free % 3, f[run.model.layout["plate.elastic"]])
    assert np.abs(plate + [x, y, z]).max() < 1e-12 * load
    heat = f[run.model.layout["block.thermal"]].sum()
    assert heat == pytest.approx(f[run.model.layout["plate.thermal"]].sum(), rel=1e-9)
    assert 2 * heat == pytest.approx(drag * SPEED, rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize("reducer", [
    {"use": "galerkin"},
    {"use": "sparse", "sampler": "deim", "budgets": {"*.elastic": {"rows": 27},
                                                     "*.thermal": {"rows": 9}}}],
    ids=["galerkin", "sparse"])
def test_a_reduced_run_repeats_its_training(reducer: dict[str, Any]) -> None:
    reference = full()
    made = {**reducer, "basis": {"use": "pod", "count": 12}}
    learnt = {n: reference.block(n).T for n in reference.model.reducible()}
    run = march(scene(reducer=made), model=reference.model, snapshots=learnt)
    assert isinstance(run.solver, ReducedGeneral)
    for b in reference.model.layout:
        want, maps = reference.block(b.name), run.solver.dictionaries
        got = run.block(b.name)
        if b.name in maps:
            got = np.asarray(maps[b.name].offset + got @ maps[b.name].atoms.T)
        error = np.abs(got - want)[1:].max() / np.abs(want).max()
        assert error < (1e-4 if b.field == "multiplier" else 1e-5), (b.name, error)


