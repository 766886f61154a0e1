"""Parts of scenes in a package of their own: a body, a joint and a load, by public names alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies import (
    BODY_KINDS,
    Between,
    Conditions,
    DenseTerm,
    FloatingBody,
    LoadPart,
    MassProperties,
    Pose,
)
from sparsemor.core import (
    Body,
    BodyPlugin,
    Equations,
    FieldKind,
    FloatArray,
    InputError,
    LoadPlugin,
    Part,
)


class Ring(BodyPlugin):
    """Thin rigid ring in the plane. Points: centre, rim."""

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    mass: float = Field(gt=0)
    """Mass, kg."""
    radius: float = Field(gt=0)
    """Radius, m."""
    pose: Pose = Pose()
    """Centre, rotation and their rates at the start."""

    def build(self, name: str, base: Path) -> FloatingBody:
        pose, velocity = self.pose.in_plane()
        return FloatingBody(
            name=name, X=np.array([[0.0, 0.0], [self.radius, 0.0]]), pose=pose, velocity=velocity,
            inertia=MassProperties.rigid(self.mass, np.zeros(2), self.mass * self.radius**2),
            moves=True, points={"centre": np.array([0]), "rim": np.array([1])})


class Gear(Between):
    """Pair of gears: angle_1 + ratio angle_2 keeps its value. The multiplier is a moment, N m."""

    dimensions = (2,)

    ratio: float = 1.0
    """Radius of the second wheel over that of the first."""

    def constrain(self, sides: Conditions) -> None:
        sides.couple_rotations(self.ratio)


class Spring(LoadPlugin):
    """Linear spring without length at rest, from a point of a planar body to a point in space."""

    on: str
    """The material point or set `body:set`."""
    to: tuple[float, float]
    """The other end, m (space axes)."""
    stiffness: float = Field(gt=0)
    """Stiffness, N/m."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        body, _, which = self.on.partition(":")
        part = parts.get(body)
        probe = part.probe(name, which) if isinstance(part, Body) else None
        if probe is None:
            raise InputError(f"no body with material points is called {body!r}", "on")
        if len(probe.point) != 2:
            raise InputError(f"body {body!r} is in space, this spring is plane", "on")
        W = np.zeros((0, 2)) if probe.displacement is None else probe.displacement
        near = np.flatnonzero(W.any(axis=1))
        W, k = W[near], self.stiffness

        def law(x: FloatArray, v: FloatArray, t: float) -> tuple[FloatArray, ...]:
            """Gradient and Hessian of k |d|^2 / 2 by the pose, where it is unknown, and u."""
            frame = len(x) - len(near)
            pose = probe.pose if probe.guide is None else probe.guide.at(t)[0]
            y = x[:frame] if frame else pose
            c, s = np.cos(y[2]), np.sin(y[2])
            A, dA = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
            z = probe.point + W.T @ x[frame:]
            d = y[:2] + A @ z - self.to
            G = np.column_stack([np.eye(2), dA @ z, A @ W.T])
            H = G.T @ G
            H[2, 2] -= d @ (A @ z)
            H[2, 3:] += d @ dA @ W.T
            H[3:, 2] = H[2, 3:]
            skip = 3 - frame
            return k * (G.T @ d)[skip:], k * H[skip:, skip:], 0.0 * H[skip:, skip:]

        def write(equations: Equations) -> None:
            blocks = [b for b in (f"{body}.rigid", f"{body}.elastic") if equations.size(b)]
            rigid, elastic = (equations.numbers(f"{body}.{f}") for f in ("rigid", "elastic"))
            at = np.concatenate([rigid, elastic[near]])
            equations.local(blocks, DenseTerm(at, at, law))

        return LoadPart(name, write)
