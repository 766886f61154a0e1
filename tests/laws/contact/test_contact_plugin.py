"""A contact that a third party writes, in a two-stage scene: public names of the core only."""

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.testing.in_memory_run import scene_of

FEET = '''
"""Feet on springs: a set of points of one body, held at a height by springs on its frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import ReducedTerm, Term
from sparsemor.core import Contact, ContactPlugin
from sparsemor.core.protocols.prescribed_motion import SurfaceLoads


@dataclass(frozen=True)
class Spring(Term):
    """k (y - level) on the vertical equation of a frame."""

    rows: Any
    k: float
    level: float
    elements: int = 0

    @property
    def columns(self):
        return self.rows

    def residual(self, x, v, a, t):
        return self.k * (x - self.level)

    def jacobian(self, x, v, a, t, c1, c2):
        return csr_array([[self.k]])

    def restrict(self, keep):
        return self

    def compress(self, trial, left):
        return Compressed(self, trial, left)


@dataclass(frozen=True)
class Compressed(ReducedTerm):
    spring: Spring
    trial: Any
    left: Any
    elements: int = 0

    def residual(self, x, v, a, t):
        y = self.trial.offset + self.trial.atoms @ x
        return self.left @ self.spring.residual(y, v, a, t)

    def jacobian(self, x, v, a, t, c1, c2):
        return self.left @ (self.spring.k * self.trial.atoms)


@dataclass(frozen=True)
class Feet(Contact):
    name: str
    body: Any
    nodes: Any
    k: float
    level: float

    def contribute(self, equations):
        block = f"{self.body.name}.rigid"
        equations.local([block], Spring(equations.numbers(block)[1:2], self.k, self.level))

    def imported(self, motion):
        pose = motion[self.body.name].pose
        each = self.k * (self.level - pose[:, 1]) / len(self.nodes)
        turned = np.stack([np.sin(pose[:, 2]), np.cos(pose[:, 2])], axis=1)  # up, in body axes
        force = (each[:, None] * turned)[:, None, :].repeat(len(self.nodes), axis=1)
        heat = np.full((len(pose), len(self.nodes)), 2.0 / len(self.nodes))
        return {self.body.name: SurfaceLoads(self.nodes, force, heat)}

    def history(self, motion):
        pose = motion[self.body.name].pose
        return {"normal": self.k * (self.level - pose[:, 1])}


class SpringFeet(ContactPlugin):
    """Springs under a set of points."""

    on: str
    """Points `body:set`."""
    stiffness: float
    """N/m."""
    level: float = 0.0
    """Height at which the springs are at rest, m."""

    def build(self, name: str, parts: Mapping[str, Any]) -> Feet:
        body, _, points = self.on.partition(":")
        return Feet(name, parts[body], parts[body].points[points], self.stiffness, self.level)
'''

SCENE = {
    "bodies": {"block": {
        "use": "flexible", "thickness": 0.1,
        "mesh": {"use": "rectangle", "lower": [-0.1, 0.0], "size": [0.2, 0.1], "divisions": [8, 4]},
        "material": {"E": 1e7, "nu": 0.3, "rho": 1000, "alpha": 0.0, "k": 100, "c": 500},
        "fields": ["elastic", "thermal"], "reference": {"clamp": "top"}}},
    "loads": {"weight": {"use": "gravity", "g": [0.0, -10.0]}},
    "contacts": {"feet": {"use": "spring_feet", "on": "block:bottom", "stiffness": 5e3}},
    "rigid_stage": {}, "time": {"end": 0.1, "step": 1e-3}, "integrator": "bdf1",
}
MASS = 0.2 * 0.1 * 0.1 * 1000


@pytest.fixture
def scene(distribute):
    distribute("feet", {"contact": {"spring_feet": "feet:SpringFeet"}}, feet=FEET)
    return scene_of(SCENE)


@pytest.mark.full
def test_the_stage_moves_by_the_term_and_the_fields_take_what_is_imported(scene, tmp_path):
    run = simulate(scene, cache=Cache(tmp_path))
    stage = run.stage()
    y, force = stage.frames["block"].pose[:, 1], stage.contacts["feet"]["normal"]
    np.testing.assert_allclose(
        MASS * stage.frames["block"].acceleration[:, 1], force - MASS * 10.0, atol=1e-9)
    assert y.min() < -1.9 * MASS * 10.0 / 5e3 * 0.8  # it swings about its rest
    model, _ = prepared(scene, Cache(tmp_path), new_manager())
    (table,) = model.separated.moving[0].operators.tables
    for i in (0, 40, 90):
        load = table.at(float(stage.times[i]))
        up = model.geometry["block.elastic"][1] == 1
        assert abs(load[up].sum() - force[i]) < 1e-9
    assert set(model.loaded["block.elastic"]) == {"feet"}
    # heat: 2 W into an insulated body, whatever else happens
    (heat,) = model.separated.heat
    T = run.block("block.thermal")
    stored = heat.capacity.sum(axis=0) @ (T[-1] - T[0])
    assert abs(stored - 2.0 * 0.1) < 1e-9


@pytest.mark.full
def test_the_fields_answer_the_difference_between_springs_and_weight(scene, tmp_path):
    """Free fall without springs: no load, no deformation. On springs at rest: the static answer."""
    falling = simulate(scene.using({"contacts.feet.stiffness": 0.0}), cache=Cache(tmp_path))
    resting = simulate(scene.using({"bodies.block.pose.position": [0.0, -MASS * 10.0 / 5e3]}),
                       cache=Cache(tmp_path))
    u = resting.block("block.elastic")
    assert np.abs(falling.block("block.elastic")).max() < 1e-10 * np.abs(u).max()
    model, _ = prepared(scene, Cache(tmp_path), new_manager())
    assert np.ptp(resting.stage().frames["block"].pose[:, 1]) < 1e-12
    ops = model.separated.moving[0].operators
    up = model.geometry["block.elastic"][1] == 1
    weight = -np.where(up, np.asarray(ops.mass.sum(axis=1)).ravel(), 0.0) * 10.0
    lifted = resting.stage().contacts["feet"]["normal"][0] / 9 * ops.tables[0].columns.sum(axis=1)
    from scipy.sparse.linalg import spsolve

    want = spsolve(ops.stiffness.tocsc(), weight + np.where(up, lifted, 0.0))
    assert np.abs(u[-1] - want).max() < 0.05 * np.abs(want).max()
