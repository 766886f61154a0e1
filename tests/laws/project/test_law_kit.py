"""Every installed plugin of every kind, third-party ones included, keeps the laws of its kind."""

from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from joint_runs import driven
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import load
from sparsemor.core.testing import (
    check_basis,
    check_check,
    check_friction_law,
    check_function,
    check_integrator,
    check_linear_solver,
    check_material,
    check_mesh_plugin,
    check_normal_law,
    check_observer,
    check_parts,
    check_preconditioner,
    check_reducer,
    check_sampler,
    check_sparse_solver,
    installed,
)
from sparsemor.core.testing.in_memory_run import scene_of
from tiers import full

SCENES = Path(__file__).parents[2] / "scenes"
BUDGETS = {"*.elastic": {"rows": 24, "atoms": 4}, "*.thermal": {"rows": 12, "atoms": 3}}
OPTIONS: dict[tuple[str, str], dict[str, Any]] = {
    ("function", "constant"): {"level": 3.0},
    ("function", "table"): {"times": (0.0, 1.0, 3.0), "values": (2.0, 4.0, -2.0)},
    ("function", "ramp"): {"start": 0.5, "end": 2.5, "final": -3.0},
    ("function", "pulse"): {"start": 0.5, "duration": 1.0, "level": 7.0},
    ("function", "sine"): {"amplitude": 2.0, "frequency": 0.7},
    ("function", "smooth_step"): {"start": 0.5, "end": 2.5, "final": -3.0},
    ("function", "sum"): {"terms": (1.0, {"use": "sine", "amplitude": 2.0, "frequency": 0.7})},
    ("function", "pid"): {"sensor": "arm.rigid.angle", "kp": 1.0},
    ("function", "product"): {"factors": (3.0, {"use": "smooth_step", "end": 2.0, "final": 1.0})},
    ("normal_law", "elastic_foundation"): {
        "stiffness": 1e9, "damping": 1e5, "damping_depth": 1e-6},
    ("material", "isotropic"): {"rho": 2700.0, "E": 7e10, "nu": 0.33, "k": 150.0, "c": 900.0},
    ("material", "orthotropic"): {
        "rho": 1600.0, "E": (1.2e11, 9e9, 8e9), "nu": (0.3, 0.28, 0.4), "G": (5e9, 4.5e9, 3e9),
        "k": (40.0, 5.0, 2.0), "c": 900.0, "angle": 0.5, "axis": (1.0, 2.0, 3.0)},
    ("friction_law", "coulomb"): {"coefficient": 0.3, "critical_velocity": 0.05},
    ("friction_law", "stick"): {"coefficient": 0.3, "displacement": 1e-6, "static": 0.4,
                                "decay_velocity": 0.1},
    ("mesh", "rectangle"): {"size": (2.0, 1.0), "divisions": (4, 3)},
    ("mesh", "unstructured"): {"size": (2.0, 1.0), "divisions": (4, 2), "elements": 24},
    ("mesh", "file"): {"path": "bar.vtk"},
    ("mesh", "gmsh"): {"geometry": "square.geo", "size": 0.3},
    ("mesh", "block"): {"size": (2.0, 1.0, 0.5), "divisions": (3, 2, 1)},
    ("reducer", "sparse"): {"budgets": BUDGETS},
    ("basis", "dictionary"): {"bases": ["pod", "modal"]},
}
"""What plugins need that have no default for everything."""
PACKAGES = {"pardiso": "pypardiso", "cholmod": "sksparse", "amg": "pyamg"}
"""What linear solvers need that may be absent: then they must say so."""


def linear_solver(solver: Any, seed: int) -> None:
    name = next(n for n, cls in installed("linear_solver").items() if cls is type(solver))
    lacking = find_spec(PACKAGES.get(name, "numpy")) is None
    with pytest.raises(InputError, match=PACKAGES[name]) if lacking else nullcontext():
        check_linear_solver(solver, seed, trials=1)


SWING: dict[str, Any] = {
    "bodies": {"rod": {"use": "rigid", "mass": 1.0, "inertia": 0.1, "center": [0.5, 0.0],
                       "points": {"top": [0.0, 0.0]}}},
    "joints": {"pin": {"use": "revolute", "between": ["ground", "rod:top"]}},
    "loads": {"weight": {"use": "gravity"}}, "reducer": "full", "integrator": "bdf1",
    "time": {"end": 0.5, "step": 0.02}}
LAWS: dict[str, Callable[[Any, int], None]] = {
    "basis": lambda p, seed: check_basis(p, seed, trials=3),
    "sampler": lambda p, seed: check_sampler(p, seed, trials=4),
    "preconditioner": lambda p, seed: check_preconditioner(p, seed, trials=1),
    "sparse_solver": lambda p, seed: check_sparse_solver(p, seed, trials=1),
    "linear_solver": linear_solver,
    "integrator": check_integrator,
    "function": check_function,
    "normal_law": check_normal_law,
    "friction_law": check_friction_law,
    "material": lambda p, seed: check_material(p),
    "observer": lambda p, seed: check_observer(p.observer, seed),
    "check": lambda p, seed: check_check(p, scene_of(SWING)),
}
SCENE_KINDS = {"body", "joint", "load", "contact"}
QUICK = {"sparse_solver": {"greedy_gauss_newton"}, "check": {"energy_lost"}}
"""Of the kinds whose laws take long: those that the default tier checks."""
RANDOM = [pytest.param(kind, name, marks=[pytest.mark.full] * (name not in QUICK.get(kind, {name})))
          for kind in LAWS for name in installed(kind)]


def made(kind: str, name: str) -> Any:
    return installed(kind)[name](**OPTIONS.get((kind, name), {}))


def test_every_kind_has_laws() -> None:
    others = {"mesh", "reducer", "scene", "study", "paper", "command", "charts", "choice",
              *SCENE_KINDS}
    assert set(Registry().kinds()) <= set(LAWS) | others


@pytest.mark.parametrize(("kind", "name"), RANDOM, ids=lambda word: str(word))
def test_laws_over_random_inputs(kind: str, name: str) -> None:
    LAWS[kind](made(kind, name), 7)


@pytest.mark.parametrize("name", installed("mesh"))
def test_laws_of_a_mesh(name: str, tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    meshio.Mesh(points, [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))]).write(
        tmp_path / "bar.vtk")
    if name == "gmsh":
        pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
        (tmp_path / "square.geo").write_text(
            'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\n')
    check_mesh_plugin(made("mesh", name), tmp_path)


@pytest.mark.parametrize(("name", "integrator"), [("sparse", "bdf2"), *(
    full(name, "bdf2") for name in installed("reducer") if name != "sparse"), *(
    full("sparse", name) for name in installed("integrator") if name != "bdf2")])
def test_laws_of_a_reducer(name: str, integrator: str) -> None:
    """Each reducer with one integrator, and one reducer with each integrator."""
    options = {"use": name, **OPTIONS.get(("reducer", name), {})}
    short = {"time.end": 0.02, "training.end": 0.02}
    check_reducer(load(SCENES / "tiny.yaml", {
        **short, "reducer": options, "integrator": integrator}))


def machine() -> dict[str, Any]:
    """Shafts with a gear, a rack, a universal joint, a stop, friction, a body on a bushing, and a
    heated one."""
    def body(*position: float) -> dict[str, Any]:
        return {"use": "rigid", "mass": 2.0, "inertia": [0.02, 0.03, 0.02],
                "points": {"p": [0.0, 0.0, 0.0]}, "pose": {"position": list(position)}}

    z = {"axis": [0.0, 0.0, 1.0]}
    return {
        "bodies": {
            "one": body(0.0, 0.0, 0.0), "two": body(0.5, 0.0, 0.0), "bar": body(0.0, 0.3, 0.0),
            "out": body(0.0, 0.0, 0.0), "block": body(0.0, 0.0, 1.0),
            "coil": {"use": "flexible", "mesh": {"use": "block", "size": [0.2, 0.1, 0.1],
                                                 "divisions": [2, 1, 1]},
                     "material": {"rho": 7800.0, "k": 40.0, "c": 500.0}, "fields": ["thermal"],
                     "frame": "fixed"}},
        "joints": {
            **{f"hold_{b}": {"use": "revolute", "between": ["ground", f"{b}:p"], **z}
               for b in ("one", "two", "out")},
            "guide": {"use": "prismatic", "between": ["bar:p", "ground"], "axis": [1.0, 0.0, 0.0]},
            "gear": {"use": "gear", "between": ["one:p", "two:p"], "teeth": [20, 30], **z},
            "rack": {"use": "rack", "between": ["one:p", "bar:p"], "radius": 0.3,
                     "direction": [1.0, 0.0, 0.0], **z},
            "cross": {"use": "universal", "between": ["one:p", "out:p"], "axis": [1.0, 0.0, 0.0],
                      "second_axis": [0.0, 1.0, 0.0]},
            "stop": {"use": "stop", "between": ["two:p", "ground"], "upper": 0.1,
                     "stiffness": 200.0, **z},
            "friction": {
                "use": "joint_friction", "between": ["two:p", "ground"], "force": 0.1, **z},
            "mount": {"use": "bushing", "between": ["block:p", "ground"],
                      "stiffness": [1e3, 2e3, 3e3]}},
        "loads": {"motor": {"use": "torque", "on": "one:p", "torque": [0.0, 0.0, 1.0]},
                  "current": {"use": "heat_source", "on": ["coil"], "power": 5.0},
                  "wire": {"use": "joule_heat", "on": "coil", "conductivity": 1e6, "electrodes": {
                      "left": {"potential": 0.0}, "right": {"current": 10.0}}},
                  "glow": {"use": "cavity_radiation", "on": ["coil:top", "coil:left"],
                           "emissivity": 0.9, "surroundings": 400.0}},
        "time": {"end": 0.02, "step": 1e-3}}


def ring() -> dict[str, Any]:
    """A spinning body of revolution."""
    return {"bodies": {"ring": {
                "use": "flexible", "axisymmetric": True, "frame": "fixed", "fields": ["elastic"],
                "mesh": {"use": "rectangle", "lower": [0.1, 0.0], "size": [0.1, 0.02],
                         "divisions": [4, 1]},
                "material": {"E": 2e11, "nu": 0.3, "rho": 7800.0},
                "reference": {"hold": {"bottom": "y"}}}},
            "loads": {"spin": {"use": "centrifugal", "body": "ring", "spin": 300.0}},
            "time": {"end": 0.02, "step": 1e-3}}


@pytest.mark.full
def test_laws_of_bodies_joints_and_loads() -> None:
    scenes = [*(load(SCENES / name) for name in (
        "everything.yaml", "everything_in_space.yaml", "matrices.yaml")), scene_of(driven()),
        scene_of(machine()), scene_of(ring())]
    for scene in scenes:
        check_parts(scene)
    for kind, key in (("body", "bodies"), ("joint", "joints"), ("load", "loads")):
        own = {p.name for p in Registry().names(kind) if p.distribution == "sparsemor"}
        assert own <= {e["use"] for scene in scenes for e in scene.dump()[key].values()}


@pytest.mark.parametrize("name", [p.name for p in Registry().names("scene")])
def test_packaged_scenes_load_and_say_what_they_are(name: str) -> None:
    scene = load(name)
    assert scene.title and scene.name == name
    assert load(name).digest() == scene.digest()
