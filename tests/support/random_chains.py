"""Random chains of links in the plane, and what may be done to a scene without changing its motion.

A scene is a tree as `yaml` gives it. All numbers come from a seeded generator.
"""

import copy
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source

Tree = dict[str, Any]
Rng = np.random.Generator
STEP, STEPS = 1.0e-3, 30
INTEGRATORS: tuple[Any, ...] = (
    "bdf1", "bdf2", {"use": "generalized_alpha", "rho_inf": 0.8})


def scene(tree: Tree) -> Scene:
    """A validated scene of a tree."""
    return build(Source.of_tree(copy.deepcopy(tree)))


def chain(rng: Rng, links: int | None = None, rigid: bool | None = None) -> Tree:
    """One to three pinned links, flexible or rigid, under gravity, heat and a swinging force.

    rigid: whether all links are; by chance when not given.
    """
    count = int(rng.integers(1, 4)) if links is None else links
    bodies: Tree = {}
    joints: Tree = {}
    loads: Tree = {"weight": {"use": "gravity", "g": [0.0, -9.81]}}
    at, before = rng.uniform(-0.5, 0.5, 2), "ground"
    for i in range(count):
        name, angle = f"link{i}", float(rng.uniform(-np.pi, np.pi))
        length, height = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.05, 0.1))
        stiff = rng.random() < 0.25 if rigid is None else rigid
        if rigid is None and i == count - 1 and all(b["use"] == "rigid" for b in bodies.values()):
            stiff = False  # at least one link bends
        pose = {"position": [float(x) for x in at], "angle": angle}
        bodies[name] = _bar(length, 2.0, pose) if stiff else _link(rng, length, height, pose)
        joints[f"pin{i}"] = {"use": "revolute", "between": [before, f"{name}:left"]}
        if not stiff and "thermal" in bodies[name]["fields"]:
            loads[f"heat{i}"] = {"use": "heat_flux", "on": [f"{name}:right"],
                                 "flux": float(rng.uniform(1e5, 1e6))}
        at, before = at + length * np.array([np.cos(angle), np.sin(angle)]), f"{name}:right"
    loads["push"] = {
        "use": "point_force", "on": before, "force": [float(f) for f in rng.uniform(-20, 20, 2)],
        "factor": {"use": "sine", "amplitude": 1.0, "frequency": 15.0, "phase": 1.0}}
    rule = INTEGRATORS[int(rng.integers(len(INTEGRATORS)))]
    return {"format": 1, "bodies": bodies, "joints": joints, "loads": loads, "integrator": rule,
            "time": {"end": STEP * STEPS, "step": STEP}}


def _bar(length: float, mass: float, pose: Tree) -> Tree:
    """A thin rigid rod."""
    return {"use": "rigid", "mass": mass, "inertia": mass * length**2 / 12,
            "center": [length / 2, 0.0], "points": {"left": [0.0, 0.0], "right": [length, 0.0]},
            "pose": pose}


def _link(rng: Rng, length: float, height: float, pose: Tree) -> Tree:
    return {
        "use": "flexible",
        "mesh": {"use": "rectangle", "lower": [0.0, -height / 2], "size": [length, height],
                 "divisions": [6, 2]},
        "sets": {"end_a": {"nearest": [0.0, 0.0]}, "end_b": {"nearest": [length, 0.0]}},
        "thickness": 0.03,
        "material": {"E": float(10 ** rng.uniform(7.0, 10.0)), "nu": 0.3,
                     "rho": float(rng.uniform(1000, 8000)), "alpha": 1.2e-5, "k": 50.0, "c": 500.0},
        "fields": ["elastic", "thermal"] if rng.random() < 0.7 else ["elastic"],
        "reference": {"chord": ["end_a", "end_b"]} if rng.random() < 0.5 else {"clamp": "left"},
        "damping": {"stiffness": float(rng.choice([0.0, 1e-4]))},
        "pose": pose}


def moved(tree: Tree, by: tuple[float, float]) -> Tree:
    """The whole scene at another place."""
    return _posed(tree, lambda p: {**p, "position": [p["position"][0] + by[0],
                                                     p["position"][1] + by[1]]})


def turned(tree: Tree, angle: float) -> Tree:
    """The whole scene, forces in space included, turned about the origin."""
    made = _posed(tree, lambda p: {**p, "position": rotated(p["position"], angle),
                                   "angle": p["angle"] + angle})
    for load in made["loads"].values():
        for key in ("g", "force"):
            if key in load:
                load[key] = rotated(load[key], angle)
    return made


def rotated(vector: list[float], angle: float) -> list[float]:
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return [c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]]


def reordered(tree: Tree) -> Tree:
    """The same parts, written in the opposite order."""
    return {key: dict(reversed(list(value.items())))
            if key in ("bodies", "joints", "loads") else value
            for key, value in copy.deepcopy(tree).items()}


def doubled(tree: Tree) -> Tree:
    """The scene and, in the same file, a copy of it under other names, aside."""
    made = copy.deepcopy(tree)
    other = moved(tree, (3.0, -2.0))
    for group in ("bodies", "joints"):
        for name, part in other[group].items():
            made[group][f"{name}_copy"] = _renamed(part)
    for name, load in other["loads"].items():
        if load["use"] != "gravity":
            made["loads"][f"{name}_copy"] = _renamed(load)
    return made


def _renamed(part: Any) -> Any:
    if isinstance(part, Mapping):
        return {k: _renamed(v) if k in ("between", "on") else v for k, v in part.items()}
    if isinstance(part, list):
        return [_renamed(p) for p in part]
    name, colon, where = str(part).partition(":")
    return part if name == "ground" else f"{name}_copy{colon}{where}"


def halved(tree: Tree, name: str) -> Tree:
    """A rigid rod of the chain as two rods that are fixed to each other."""
    made = copy.deepcopy(tree)
    whole = made["bodies"][name]
    length, mass = whole["points"]["right"][0], whole["mass"]
    pose, half = whole["pose"], length / 2
    far = {**pose, "position": [p + half * d for p, d in zip(
        pose["position"], (np.cos(pose["angle"]), np.sin(pose["angle"])), strict=True)]}
    made["bodies"][name] = _bar(half, mass / 2, pose)
    made["bodies"]["second"] = _bar(half, mass / 2, far)
    for part in (*made["joints"].values(), *made["loads"].values()):
        for key in ("between", "on"):
            if key in part:
                part[key] = _ends(part[key], name)
    made["joints"]["weld"] = {"use": "fixed", "between": [f"{name}:right", "second:left"]}
    return made


def _ends(value: Any, name: str) -> Any:
    if isinstance(value, list):
        return [_ends(v, name) for v in value]
    return "second:right" if value == f"{name}:right" else value


POWERS: dict[str, tuple[int, int, int]] = {  # of length, mass and time
    "mass": (0, 1, 0), "inertia": (2, 1, 0), "center": (1, 0, 0), "points": (1, 0, 0),
    "position": (1, 0, 0), "lower": (1, 0, 0), "size": (1, 0, 0), "nearest": (1, 0, 0),
    "thickness": (1, 0, 0), "E": (-1, 1, -2), "rho": (-3, 1, 0), "k": (1, 1, -3),
    "c": (2, 0, -2), "stiffness": (0, 0, 1), "g": (1, 0, -2), "force": (1, 1, -2),
    "flux": (0, 1, -3), "frequency": (0, 0, -1), "end": (0, 0, 1), "step": (0, 0, 1)}


def in_units(tree: Tree, length: float, mass: float, time: float) -> Tree:
    """The same scene in other units: one metre is `length` of the new ones, and so on."""
    def scaled(value: Any, factor: float) -> Any:
        if isinstance(value, list):
            return [scaled(v, factor) for v in value]
        if isinstance(value, Mapping):
            return {k: scaled(v, factor) for k, v in value.items()}
        return value * factor

    def walk(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {k: scaled(v, float(np.prod(np.array([length, mass, time]) ** POWERS[k])))
                    if k in POWERS else walk(v) for k, v in value.items()}
        return [walk(v) for v in value] if isinstance(value, list) else value

    made: Tree = walk(copy.deepcopy(tree))
    return made


def _posed(tree: Tree, change: Callable[[Tree], Tree]) -> Tree:
    made = copy.deepcopy(tree)
    for body in made["bodies"].values():
        body["pose"] = change(body["pose"])
    return made
