"""Every term of bodies, joints and loads in space keeps the laws of a term."""

from dataclasses import replace
from itertools import product
from math import factorial
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.fem.integrals import on_facets
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames.applied_forces import Moment, Reaction
from sparsemor.bodies.frames.frame import SpatialFrame
from sparsemor.bodies.frames.springs import Angle, Length, RelativeItem, linear
from sparsemor.bodies.loads.surface_heat import GreyBody
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import FloatArray, Mesh, Table
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import AssembledTerm
from sparsemor.core.model.frame_equations import FrameEquations
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import march, scene_of
from term_scales import scales

TURNED: dict[str, Any] = {"axis": [1.0, 2.0, -0.5], "angle": 0.7}
BAR = {
    "use": "flexible", "fields": ["elastic", "thermal"],
    "mesh": BlockMesh(size=(0.4, 0.1, 0.06), divisions=(3, 1, 1)),
    "material": {"E": 5e8, "nu": 0.3, "rho": 1100, "alpha": 1e-4, "k": 20, "c": 500},
    "damping": {"mass": 1.0, "stiffness": 1e-4},
    "reference": {"chord": ["left_front_bottom", "right_front_bottom", "left_back_bottom"]}}
PIECE = {"use": "rigid", "mass": 0.4, "inertia": [1e-3, 2e-3, 2.5e-3], "center": [0.1, 0.02, 0.03]}
POINTS = {"a": [0.0, 0.0, 0.0], "b": [0.2, 0.05, 0.0]}


def at(place: list[float]) -> list[float]:
    """Where a point of a body at TURNED is."""
    A = rot.rotation(rot.about(TURNED["axis"], TURNED["angle"]))
    return [float(c) for c in A @ np.array(place)]


def wheel_place() -> list[float]:
    """The middle of the left face of the spinning disk."""
    A = rot.rotation(rot.about([0, 0, 1], 0.3))
    return [float(c) for c in A @ [0.0, 0.05, 0.03]]


def along_disk() -> list[float]:
    """From the disk's right face to the point b of the wheel."""
    right = rot.rotation(rot.about([0, 0, 1], 0.3)) @ [0.4, 0.05, 0.03]
    b = wheel_place() + rot.rotation(rot.about([0, 0, 1], 0.8)) @ POINTS["b"]
    return [float(c) for c in right - b]


def between_wheels() -> list[float]:
    return [float(c) for c in np.array([1.0, 2.0, 3.0]) - wheel_place()]


def everything() -> dict[str, Any]:
    """A flexible bar between rigid bodies by joints of every kind, and all loads."""
    ends = {**PIECE, "points": POINTS}
    return {
        "bodies": {
            "bar": {**BAR, "pose": {**TURNED, "spin": [1.0, -2.0, 3.0]}},
            "held": {**BAR, "frame": "fixed", "reference": {"clamp": "left"}},
            "one": {**ends, "pose": {"position": at([0.4, 0.05, 0.03]), "spin": [1.0, 0.0, 0.0]}},
            "two": {**ends, "pose": {"position": at([0.0, 0.05, 0.03]), **TURNED}},
            "three": {**ends, "pose": {"position": [1.0, 2.0, 3.0], "quaternion": [1, 2, 3, 4]}},
            "four": {**ends, "pose": {"position": [1.0, 2.0, 3.5]}},
            "disk": {**BAR, "frame": "spinning", "pose": {"angle": 0.3, "spin": [0, 0, 20.0]}},
            "wheel": {**ends, "frame": "spinning",
                      "pose": {"position": wheel_place(), "angle": 0.8}}},
        "joints": {
            "ball": {"use": "spherical", "between": ["ground", "bar:left_front_bottom"]},
            "hinge": {"use": "revolute", "between": ["one:a", "bar:right"], "axis": [0, 0, 1]},
            "weld": {"use": "fixed", "between": ["bar:left", "two:a"]},
            "tube": {"use": "cylindrical", "between": ["three:a", "four:a"], "axis": [0, 0, 1]},
            "rail": {"use": "prismatic", "between": ["ground", "three:b"], "axis": [1, 1, 0]},
            "track": {"use": "prismatic", "between": ["held:right", "four:a"],
                      "axis": [1.0 - 0.4, 2.0 - 0.05, 3.5 - 0.03]},
            "drive": {"use": "prescribed_motion", "of": "four:b", "x": 0.01, "axis": [0, 1, 1],
                      "angle": {"use": "ramp", "end": 1.0, "final": 9.0}},
            "hub": {"use": "fixed", "between": ["disk:left", "wheel:a"]},
            "axle": {"use": "revolute", "between": ["ground", "wheel:b"], "axis": [0, 0, 1]},
            "shaft": {"use": "cylindrical", "between": ["disk:right", "wheel:b"],
                      "axis": along_disk()},
            "link": {"use": "prismatic", "between": ["three:a", "wheel:a"],
                     "axis": between_wheels()},
            "brake": {"use": "prescribed_motion", "of": "wheel:a", "axis": [0, 0, 1],
                      "angle": {"use": "ramp", "end": 1.0, "final": 9.0}},
            "warm": {"use": "prescribed_temperature", "on": ["bar:front"], "temperature": 310.0},
            "stand": {"use": "revolute", "between": ["held:right", "ground"], "axis": [1, 0, 0]}},
        "loads": {
            "gravity": {"use": "gravity", "g": [1.0, 2.0, -9.0]},
            "wind": {"use": "traction", "on": ["bar:top"], "traction": [30.0, 10.0, 5.0],
                     "axes": "space"},
            "push": {"use": "pressure", "on": ["bar:back", "held:top"], "pressure": 40.0},
            "pull": {"use": "point_force", "on": "one:b", "force": [1.0, -2.0, 3.0]},
            "rub": {"use": "point_force", "on": "bar:right", "force": [1, 2, 3], "axes": "body"},
            "glow": {"use": "radiation", "on": ["bar:top"], "emissivity": 0.5,
                     "surroundings": 293.0},
            "film": {"use": "convection", "on": ["bar:top"], "film": 30.0, "temperature": 300.0},
            "heat": {"use": "heat_flux", "on": ["bar:bottom"], "flux": 1e3}},
        "time": {"end": 1.0, "step": 0.1}}


LONG = ("bar", "held", "hinge", "hub", "weld", "gravity", "two", "three", "rail", "track", "drive",
        "shaft", "link", "stand", "push", "tube", "axle", "brake", "disk")
PARTS = [pytest.param(name, marks=[pytest.mark.full] * (name in LONG)) for name in (
    *everything()["bodies"], *everything()["joints"], *everything()["loads"])]


@pytest.fixture(scope="module")
def model() -> Model:
    return assemble(scene_of(everything()))


@pytest.mark.parametrize("part", PARTS)
def test_every_term_of(model: Model, part: str) -> None:
    terms = model.by_part[part]
    assert bool(terms) is not (part == "warm")  # eliminated: in the terms of its body
    rng = np.random.default_rng(7)
    for i, term in enumerate(terms):
        base = model.x0[term.columns]
        lam = term.columns >= model.layout.algebraic.start
        base[lam] = rng.standard_normal(int(lam.sum()))
        for scale in scales(model, term):
            check_term(term, np.random.default_rng(i), base=base, scale=scale, trials=3,
                       same_rates=term in frame_terms(model))


def frame_terms(model: Model) -> list[AssembledTerm[FrameEquations]]:
    return [t for t in model.terms
            if isinstance(t, AssembledTerm) and isinstance(t.equations, FrameEquations)]


def test_the_scene_has_items_of_every_kind(model: Model) -> None:
    frames = [t.equations.frame for t in frame_terms(model)]
    items = [i for f in frames if isinstance(f, SpatialFrame) for i in f.items]
    assert {type(i).__name__ for i in items} == {
        "Inertia", "UnitLength", "SpaceForce", "BodyForce", "MeanPoint", "Facing", "Slide",
        "Compliance"}
    pairs = {(type(f.items[0]).__name__, f.elastic, f.items[0].others)
             for f in frames if isinstance(f, SpatialFrame)}
    assert {("Facing", True, 7), ("Facing", False, 7), ("Facing", False, 0), ("Facing", True, 0),
            ("Facing", True, 4), ("Facing", False, 4), ("Slide", False, 7), ("Slide", False, 0),
            ("Slide", True, 7), ("Slide", True, 4)} <= pairs


def test_every_term_has_one_owner_in_the_fast_step(model: Model) -> None:
    assert model.separated.other == ()


def test_radiation_of_a_triangle_is_integrated_exactly() -> None:
    """T^4 phi is of degree 5: against integrals of monomials in area coordinates."""
    mesh = Mesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))
    (points,) = on_facets(mesh, np.array([[0, 2, 1]]), GreyBody.degree)
    phi, weights = points.shape.values[0], 2.0 * points.weights[0]
    assert sorted(points.shape.nodes[0].tolist()) == [0, 1, 2]
    for a, b, c in product(range(6), repeat=3):
        if a + b + c <= 5:
            exact = 2 * factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 2)
            assert (phi[0] ** a * phi[1] ** b * phi[2] ** c) @ weights == pytest.approx(exact)


@pytest.mark.full
def test_the_bordered_and_the_textbook_step_agree() -> None:
    scene = everything()
    for redundant in ("drive", "track", "shaft", "link", "brake"):
        del scene["joints"][redundant]
    scene["time"] = {"end": 0.002, "step": 1e-3}
    runs = [march(scene_of({**scene, "reducer": {"use": "full", "method": m}}))
            for m in ("bordered", "newton")]
    second = runs[0].model.layout.second
    for b in runs[0].model.layout:
        one, two = (r.block(b.name)[-1] for r in runs)
        size = max(float(np.abs(two).max()), 1e-9)
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-7 * size, err_msg=b.name)
    assert np.abs(runs[0].end.v[second]).max() > 1.0


AXES = np.linalg.qr(np.arange(1.0, 10.0).reshape(3, 3) ** 1.5)[0]


def more(others: int, own: int) -> list[Any]:
    """Springs to a body with this many coordinates, or at rest, and moments on body and set."""
    place = np.array([1.0, 2.0, 0.5, *([0.3] if own == 4 else [0.5, 0.5, -0.5, 0.5])])
    spring = linear(40.0, 3.0)
    return [RelativeItem(Length(others, place, AXES[0], AXES[1]), spring, drive=drive),
            RelativeItem(Angle(others, place, *AXES, place[3:]), spring, drive=drive),
            *(Moment(AXES[0], drive, turns, space) for turns in (False, True)
              for space in (False, True))]


def drive(t: float) -> float:
    return 2.0 + t


def with_more_items(m: Model) -> list[SpatialFrame]:
    found = [t.equations.frame for t in frame_terms(m)]
    made = [f for f in found if isinstance(f, SpatialFrame)]
    widest = {(f.size, f.elastic): f for f in made}.values()
    return [*made, *(replace(f, items=(*f.items, *more(others, f.size)))
                     for f in widest for others in (0, 4, 7))]


def evaluated(f: SpatialFrame, given: tuple[Any, ...], t: float) -> list[FloatArray]:
    work = FrameWork(f.p, f.border, f.generators)
    f.evaluate(*given, t, work)
    return [work.border, work.sigma, work.tau, work.coefficients]


def from_arrays(f: SpatialFrame, given: tuple[Any, ...], t: float) -> list[FloatArray]:
    work, made = FrameWork(f.p, f.border, f.generators), f.arrays()
    assert made is not None
    gains = np.array([1.0 if g is None else g(t) for g in made.amplitudes])
    work.border[:], work.sigma[:], work.tau[:] = 9.0, 9.0, 9.0  # as an earlier body left them
    made.function(made.kinds, made.numbers, made.starts, gains, *given, work.sigma, work.tau,
                  work.border, work.coefficients, np.full(320, 9.0))
    return [work.border, work.sigma, work.tau, work.coefficients]


@pytest.mark.full
def test_every_item_as_functions_on_arrays(model: Model) -> None:
    rng, t = np.random.default_rng(3), 0.3
    for f in 5 * with_more_items(model):
        y, v, a = rng.standard_normal((3, f.border))
        given = (y, v, 10.0 * a, 40.0, 1600.0, rng.standard_normal((3, f.p)),
                 rng.standard_normal(3 * f.generators))
        for want, got in zip(evaluated(f, given, t), from_arrays(f, given, t), strict=True):
            size = np.abs(want).max(initial=1.0)
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-11 * size)


def test_a_frame_with_an_item_that_is_not_given_as_arrays_has_none(model: Model) -> None:
    f = with_more_items(model)[0]
    reaction = Reaction(Table(np.array([0.0, 1.0]), np.zeros((2, 6))), False)
    assert replace(f, items=(*f.items, reaction)).arrays() is None
