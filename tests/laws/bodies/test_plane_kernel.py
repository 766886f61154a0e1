"""The planar frame kernel is the spatial one for motion in a plane: forces and Jacobians."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array

from sparsemor.bodies import BODY_KINDS, Conditions, FloatingBody, JointPart, MassProperties
from sparsemor.bodies.frames.frame import PlanarFrame, SpatialFrame
from sparsemor.bodies.joints.constraint_conditions import conditions_between, conditions_on
from sparsemor.core import BodyPlugin, FieldKind, FloatArray, JointPlugin, Part
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.model.model import Model
from sparsemor.core.testing.in_memory_run import scene_of

BAR = {
    "use": "flexible", "thickness": 0.02, "fields": ["elastic"], "reference": {"clamp": "left"},
    "mesh": {"use": "rectangle", "lower": [-0.1, -0.05], "size": [0.5, 0.1], "divisions": [4, 2]},
    "material": {"E": 5e6, "nu": 0.3, "rho": 1100}, "damping": {"mass": 0.5, "stiffness": 1e-4}}
ROD = {"use": "rigid", "mass": 2.0, "inertia": 0.05, "center": [0.3, 0.1],
       "points": {"left": [0.0, 0.0], "right": [0.5, 0.1]}}


class Lifted(BodyPlugin):
    """A planar body as it is, or in space with every z zero and a frame of `size` coordinates."""

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS
    flat: dict[str, Any]
    size: int

    def build(self, name: str, base: Path) -> FloatingBody:
        made = assemble(scene_of({"bodies": {name: self.flat}, "time": {"end": 1.0, "step": 1.0}}))
        body: Any = made.parts[name]
        flat = replace(body, mesh=None)  # sets are points on both
        return flat if self.size == 3 else in_space(flat, self.size)


def in_space(body: FloatingBody, size: int) -> FloatingBody:
    """d = 3: displacements along z are held, T_ref and temperatures as they are."""
    n, e, m = len(body.X), body.elasticity, body.inertia
    assert m is not None
    dofs = (3 * np.arange(n)[:, None] + [0, 1]).ravel()
    S = csr_array(coo_array((np.ones(2 * n), (dofs, np.arange(2 * n))), shape=(3 * n, 2 * n)))
    return FloatingBody(
        name=body.name, X=np.pad(body.X, ((0, 0), (0, 1))), moves=body.moves, points=body.points,
        inertia=MassProperties(m.mass, np.pad(m.moment, (0, 1)), np.pad(m.second, (0, 1))),
        pose=lifted(body.pose, size), velocity=0.0 * lifted(body.pose, size),
        mass_matrix=body.mass_matrix, T0=body.T0, T_ref=body.T_ref,
        elasticity=None if e is None else replace(
            e, free=dofs[e.free], stiffness=S @ e.stiffness @ S.T, damping=S @ e.damping @ S.T,
            coupling=S @ e.coupling))


def lifted(pose: FloatArray, size: int) -> FloatArray:
    """(4,) or (7,) coordinates of a frame that turns about z."""
    x, y, angle = pose
    turn = [angle] if size == 4 else [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
    return np.array([x, y, 0.0, *turn])


class Tie(JointPlugin):
    """Joints with as many rows in the plane as in space, x, y and lines in the plane."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        body: Any = parts["bar"]
        sides = conditions_on(name, "bar:left", parts)
        sides.meet(np.eye(body.d)[:2])
        return sides.joint()


class Rail(JointPlugin):
    """The mean point of a set stays on a line of another body, or of the ground."""

    between: tuple[str, str]

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        sides: Conditions = conditions_between(name, self.between, parts)
        line = np.zeros(sides.d)
        line[:2] = 0.6, 0.8
        sides.slide([line])
        return sides.joint()


@cache
def model(size: int) -> Model:
    """A flexible bar on a pin and a rail of the ground, with a rigid rod on rails of both sides."""
    third = [] if size == 3 else [0.0]
    place = [0.4, 0.0]  # of the rod, whose left end lies on the lines through the bar's right one
    return assemble(scene_of({
        "bodies": {"bar": Lifted(flat=BAR, size=size),
                   "rod": Lifted(flat={**ROD, "pose": {"position": place, "angle": 0.7}},
                                 size=size)},
        "joints": {"pin": Tie(), "track": Rail(between=("ground", "bar:right")),
                   "rail": Rail(between=("rod:left", "bar:right")),
                   "turned": Rail(between=("bar:right", "rod:left")),
                   "stiff": Rail(between=("rod:left", "ground"))},
        "loads": {"weight": {"use": "gravity", "g": [1.5, -9.81, *third]},
                  "fixed": {"use": "point_force", "on": "bar:right", "force": [30.0, 10.0, *third]},
                  "turning": {"use": "point_force", "on": "bar:top", "axes": "body",
                              "force": [-20.0, 40.0, *third]},
                  "end": {"use": "point_force", "on": "rod:right", "axes": "body",
                          "force": [5.0, 2.0, *third]}},
        "time": {"end": 1.0, "step": 1e-2}}))


def in_the_plane(flat: Model, space: Model) -> list[int]:
    """Of the unknowns in space those that the plane has, in its order."""
    found: list[int] = []
    for b in flat.layout:
        at = np.arange(space.layout.size)[space.layout[b.name]]
        found += at[[0, 1, 3]].tolist() if b.field == "rigid" else at[: b.size].tolist()
    return found


def state(m: Model, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng, n = np.random.default_rng(seed), m.layout.size
    x, v, a = m.x0.copy(), rng.standard_normal(n), 10.0 * rng.standard_normal(n)
    for b in m.layout:
        size = {"rigid": 0.5, "elastic": 1e-2, "multiplier": 100.0}[b.field]
        x[m.layout[b.name]] += size * rng.standard_normal(b.size)
        v[m.layout[b.name]] *= 0.0 if b.field == "multiplier" else size
    return x, v, a


@pytest.mark.parametrize("seed", [0])
def test_with_an_angle_about_z_forces_and_jacobian_are_equal(seed: int) -> None:
    flat, space = model(3), model(4)
    kernels = {type(m.frame) for m in flat.separated.moving}, {
        type(m.frame) for m in space.separated.moving}
    assert kernels == ({PlanarFrame}, {SpatialFrame})
    at, c1, c2 = in_the_plane(flat, space), 40.0, 1600.0
    given = state(flat, seed)
    wide = [np.zeros(space.layout.size) for _ in given]
    for w, x in zip(wide, given, strict=True):
        w[at] = x
    want = system_residual(flat.layout, flat.terms, *given, 0.0)
    got = system_residual(space.layout, space.terms, *wide, 0.0)
    np.testing.assert_allclose(got[at], want, rtol=0, atol=1e-12 * np.abs(want).max())
    out = np.setdiff1d(np.arange(space.layout.size), at)
    assert len(out) == 2 and np.abs(got[out]).max() == 0.0  # no force along z
    J, K = (system_jacobian(m.layout, m.terms, *s, 0.0, *(c * differentiated(m) for c in (c1, c2)))
            for m, s in ((flat, given), (space, wide)))
    J, K = J.toarray(), K.toarray()[np.ix_(at, at)]
    sizes = np.sqrt(np.outer(np.abs(J).max(axis=1), np.abs(J).max(axis=0)))
    assert (np.abs(K - J) <= 1e-12 * sizes).all()


def differentiated(m: Model) -> FloatArray:
    """1 for unknowns with rates, 0 for multipliers."""
    return (np.arange(m.layout.size) < m.layout.algebraic.start).astype(np.float64)
