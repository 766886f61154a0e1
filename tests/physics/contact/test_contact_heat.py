"""Heat between surfaces: friction power shared without loss, conduction where they touch."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.bodies.contact.contact_term import ContactTerm
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.contributions import Equations, Origin, Records
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.testing.in_memory_run import march, scene_of

WIDTH, SIDE = 0.02, 0.05
STEEL = {"rho": 7800.0, "k": 45.0, "c": 480.0}
BRASS = {"rho": 8500.0, "k": 110.0, "c": 380.0}


def plate(lower: list[float], size: list[float], divisions: list[int], **options: Any) -> Any:
    mesh = {"use": "rectangle", "lower": lower, "size": size, "divisions": divisions}
    return {"use": "flexible", "mesh": mesh, "thickness": WIDTH, "material": STEEL,
            "fields": ["thermal"], "reference_temperature": 0.0, **options}


def scene(
    heat: dict[str, Any] | None, block: dict[str, Any], base: dict[str, Any], *, end: float,
    step: float, **others: Any,
) -> Scene:
    contact: dict[str, Any] = {
        "use": "polygonal", "between": ["block:bottom", "base:top"],
        "normal": {"use": "elastic_foundation", "stiffness": 1e10, "damping": 1e6,
                   "damping_depth": 1e-8},
        "friction": {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.01}}
    if heat is not None:
        contact["heat"] = heat
    return scene_of({
        "bodies": {
            "block": plate([0.0, 0.0], [SIDE, SIDE], [5, 5], **block),
            "base": plate([0.0, -SIDE], [SIDE, SIDE], [7, 5], frame="fixed", **base)},
        "contacts": {"sole": contact}, "time": {"end": end, "step": step},
        "integrator": "bdf1", **others})


@pytest.mark.full
def test_layers_in_a_row_carry_the_heat_of_their_resistances() -> None:
    conductance = 2e3
    held = {"hot": {"use": "prescribed_temperature", "on": ["block:top"], "temperature": 100.0},
            "cold": {"use": "prescribed_temperature", "on": ["base:bottom"], "temperature": 0.0}}
    found = march(scene({"conductance": conductance}, {"frame": "fixed"}, {"material": BRASS},
                        end=2e5, step=1e4, joints=held))
    resistance = SIDE / STEEL["k"] + 1 / conductance + SIDE / BRASS["k"]
    flux = 100.0 / resistance
    warm, cool = found.block("block.thermal")[-1], found.block("base.thermal")[-1]
    assert warm.min() == pytest.approx(100.0 - flux * SIDE / STEEL["k"], rel=1e-9)
    assert cool.max() == pytest.approx(flux * SIDE / BRASS["k"], rel=1e-9)


def test_conduction_stops_where_the_surfaces_end() -> None:
    """A block that stands over the base by half: only that half conducts."""
    s = scene({"conductance": 1e3, "share": 0.5},
              {"frame": "fixed", "pose": {"position": [SIDE / 2, 0.0]},
               "initial_temperature": 10.0}, {}, end=1.0, step=1.0)
    model = assemble(s)
    (term,) = model.by_part["sole"]
    zero = np.zeros(len(term.columns))
    r = term.residual(model.x0[term.columns], zero, zero, 0.0)
    block = model.layout["block.thermal"]
    into_block = -r[(term.rows >= block.start) & (term.rows < block.stop)].sum()
    assert into_block == pytest.approx(-1e3 * 10.0 * WIDTH * SIDE / 2, rel=1e-12)
    assert abs(r.sum()) < 1e-13 * abs(into_block)


@pytest.mark.full
def test_a_braked_block_turns_its_energy_into_heat() -> None:
    """All that is lost is friction heat: both bodies together gain it, each its share."""
    weight, K = 1e5, 1e10
    pose = {"position": [0.0, -weight / K], "velocity": [1.0, 0.0]}
    found = march(scene(
        {"share": "effusivity"}, {"pose": pose},
        {"material": BRASS, "pose": {"position": [-0.01, 0.0]}}, end=0.01, step=1e-4,
        joints={"upright": {"use": "prescribed_motion", "of": "block:top", "angle": 0.0}},
        loads={"push": {"use": "pressure", "on": ["block:top"], "pressure": weight}}))
    gained = {}
    for name, material in (("block", STEEL), ("base", BRASS)):
        T = found.block(f"{name}.thermal")[-1]
        body: Any = found.model.parts[name]
        capacity = body.heat.capacity
        assert capacity.sum() == pytest.approx(
            material["rho"] * material["c"] * WIDTH * SIDE**2)
        gained[name] = float(np.asarray(capacity @ T).sum())
    part = found.model.parts["sole"]
    assert isinstance(part, ContactPart)
    at = found.solver.layout["block.rigid"]
    motion = FrameHistory(found.t, found.x[:, at], found.v[:, at], found.a[:, at])
    power = part.history({"block": motion})["power"]
    heat = float(power[1:].sum()) * 1e-4  # implicit Euler takes the power at the end of a step
    assert sum(gained.values()) == pytest.approx(heat, rel=1e-9)
    e = [np.sqrt(m["rho"] * m["k"] * m["c"]) for m in (STEEL, BRASS)]
    assert gained["block"] / heat == pytest.approx(e[0] / (e[0] + e[1]), rel=1e-9)
    mass = STEEL["rho"] * WIDTH * SIDE**2
    speed = found.v[:, at][:, 0]
    # Euler's own damping of the speed is the rest
    lost = 0.5 * mass * (speed[0] ** 2 - speed[-1] ** 2)
    euler = 0.5 * mass * float((np.diff(speed) ** 2).sum())
    assert heat + euler == pytest.approx(lost, rel=1e-6)


def test_conduction_along_a_known_motion_is_that_of_the_same_place() -> None:
    """The term with told frames against the term whose frames are unknowns, at one place."""
    conductance = 5e3
    moving = assemble(scene({"conductance": conductance}, {}, {}, end=1.0, step=1.0))
    told = assemble(scene({"conductance": conductance}, {"frame": "fixed"}, {}, end=1.0, step=1.0))
    pose = np.array([0.013, -1e-6, 0.0])
    motion = {"block": FrameHistory(np.array([0.0, 2.0]), np.stack([0 * pose, 2 * pose]),
                                    np.ones((2, 3)), np.zeros((2, 3)))}
    part = told.parts["sole"]
    assert isinstance(part, ContactPart)
    records = Records()
    part.conduction(Equations(told.layout, Origin("contacts", "sole"), records), motion)
    (term,) = (r.term for r in records.local)
    (free,) = moving.by_part["sole"]
    assert isinstance(free, ContactTerm)
    T = 100.0 * np.random.default_rng(0).random(len(term.columns))
    zero, v = np.zeros(len(T)), np.zeros(len(free.columns))
    r = term.residual(T, zero, zero, 1.0)
    x = np.concatenate([pose, T])  # the block's frame comes first
    want = free.residual(x, v, 0 * v, 0.0)[3:]
    assert np.abs(want).max() > 1.0
    assert r == pytest.approx(want, abs=1e-12 * np.abs(want).max())
    assert not np.any(np.isin(term.rows, np.arange(*told.layout.second.indices(10**6))))


@pytest.mark.full
def test_two_stages_heat_as_one_does_where_nothing_deforms(tmp_path: Path) -> None:
    """Friction heat and conduction: inside the step, and along the motion of a rigid stage."""
    one = scene(
        {"conductance": 2e3}, {"pose": {"position": [0.0, -1e-6], "velocity": [0.3, 0.0]},
                               "initial_temperature": 30.0}, {"material": BRASS},
        end=2e-3, step=1e-4,
        loads={"push": {"use": "pressure", "on": ["block:top"], "pressure": 1e4}})
    two = one.using({"rigid_stage": {}})
    found = [simulate(s, out=tmp_path / name, cache=Cache(tmp_path))
             for s, name in ((one, "one"), (two, "two"))]
    for block in ("block.thermal", "base.thermal"):
        for run in found:  # what one body loses to the other is no loss
            balance = run.summary["heat_balance"][block]
            assert balance["share"] < 1e-9
            assert balance["brought_in"] == pytest.approx(balance["stored"], rel=1e-9)
            assert abs(balance["stored"]) > 0.1
        a, b = (r.block(block) for r in found)
        rise = np.abs(a - a[0]).max()
        assert rise > 1e-3
        assert np.abs(a - b).max() < 1e-6 * rise
