"""A plugin without the ability that a feature of the scene needs is refused before any run."""

from pathlib import Path

import pytest

from sparsemor import load, simulate
from sparsemor.core import InputError, hookimpl
from sparsemor.core.model.optional_features import FEATURES
from sparsemor.core.simulation.validation import checked_model

ROD = Path(__file__).parents[1] / "support" / "own_rod.py"
LACKING = '''
"""Plugins with what their kind must have, and no more."""

import numpy as np
from own_rod import Rod

from sparsemor.core import (
    Block, Body, Contact, ContactPlugin, FieldKind, Joint, JointPlugin, Reducer, SurfaceLoads)

FORCE = FieldKind("force", order=0, unit="N")


class Plain(Reducer):
    """A reducer."""

    def prepare(self, problem):
        raise NotImplementedError


class StiffRod(Rod):
    """A body whose frame cannot follow a motion."""

    def build(self, name, base):
        return Stiff(super().build(name, base))


class Stiff(Body):
    def __init__(self, rod):
        self.name, self.pose, self.rod = rod.name, rod.pose, rod

    def blocks(self):
        return self.rod.blocks()

    def contribute(self, equations):
        self.rod.contribute(equations)


class Part(Contact):
    def __init__(self, name):
        self.name = name

    def contribute(self, equations):
        pass


class Glue(JointPlugin):
    """A joint."""

    def build(self, name, parts):
        return Glued(name)


class Glued(Joint):
    def __init__(self, name):
        self.name = name

    def blocks(self):
        return [Block(self.name, FORCE, 1)]

    def contribute(self, equations):
        pass


class Near(ContactPlugin):
    """A contact."""

    def build(self, name, parts):
        return Part(name)


class Pad(ContactPlugin):
    """A contact that makes surface loads."""

    def build(self, name, parts):
        return Pressing(name)


class Pressing(Part):
    def imported(self, motion):
        one = len(motion["rod"].times)
        return {"rod": SurfaceLoads(np.zeros(1, int), np.zeros((one, 1, 2)), np.zeros((one, 1)))}

    def history(self, motion):
        return {}
'''
PLUGINS = {
    "body": {"rod": "own_rod:Rod", "stiff_rod": "lacking:StiffRod"},
    "contact": {"near": "lacking:Near", "pad": "lacking:Pad"},
    "joint": {"glue": "lacking:Glue"}, "reducer": {"plain": "lacking:Plain"}}
SCENE = """\
format: 1
bodies:
  rod: {use: rod, cells: 4, capacity: 1.0, conductance: 1.0, power: 1.0}
time: {end: 1.0, step: 0.5}
"""
STIFF = {"use": "stiff_rod", "cells": 4, "capacity": 1.0, "conductance": 1.0}
CASES = {
    "probe(name, at)": ({"probes": {"tip": {"body": "rod", "at": "end"}}}, "probes.tip.body",
                        "BuiltRod"),
    "with_motion(motion)": ({"rigid_stage": {}, "bodies.rod": STIFF}, "bodies.rod", "Stiff"),
    "known(reactions)": ({"rigid_stage": {}, "joints": {"glue": {"use": "glue"}}},
                         "joints.glue", "Glued"),
    "imported(motion)": ({"rigid_stage": {}, "contacts": {"near": {"use": "near"}}},
                         "contacts.near", "Part"),
    "surface_loads(equations, loads, times)": (
        {"rigid_stage": {}, "contacts": {"pad": {"use": "pad"}}}, "bodies.rod", "BuiltRod"),
}
"""Method -> changes to the scene, where they are refused, the class that lacks it."""


class Phases:
    """Whether a run began."""

    begun = False

    @hookimpl
    def on_start(self, run):
        self.begun = True


@pytest.fixture
def scene(distribute, here) -> Path:
    distribute("lacking-pkg", PLUGINS, own_rod=ROD.read_text(), lacking=LACKING)
    path = Path("scene.yaml")
    path.write_text(SCENE)
    return path


@pytest.mark.parametrize("feature", FEATURES, ids=lambda f: f.method)
def test_what_a_feature_needs_is_asked_before_a_run(scene, feature) -> None:
    changes, key, lacking = CASES[feature.method]
    assert any(option.startswith(feature.option) for option in changes)
    loaded, phases = load(scene, changes), Phases()
    for refuse in (checked_model, lambda s: simulate(s, observers=[phases])):
        with pytest.raises(InputError) as caught:
            refuse(loaded)
        (fault,) = caught.value.faults
        assert fault.key == key
        assert fault.message.startswith(f"with {feature.option}, it has to {feature.need}, which ")
        assert fault.message.endswith(f"{lacking} cannot: it has no {feature.method}")
    assert not phases.begun


def test_a_reducer_says_whether_adaptive_steps_may_return(scene) -> None:
    with pytest.raises(InputError, match="time.control: adaptive steps begin at .*Plain cannot"):
        checked_model(load(scene, {"time.control": {"tolerance": 0.1}, "reducer": "plain"}))


def test_each_plugin_of_these_is_fine_by_itself(scene) -> None:
    checked_model(load(scene, {"reducer": "plain", "bodies.rod": STIFF}))
    checked_model(load(scene, {"contacts": {"near": {"use": "near"}, "pad": {"use": "pad"}}}))
