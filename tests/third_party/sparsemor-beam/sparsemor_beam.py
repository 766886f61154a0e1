"""A planar beam of Euler and Bernoulli with rotations at its nodes, in a floating frame.

A point of the axis has the displacement N(x) q, with two nodes of (u, v, theta) on each element: u
is linear along the axis, and v is the cubic of Hermite, whose slope is theta. All integrals over
the axis are exact. The frame, joints, forces, gravity and reducers are those of sparsemor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.bodies import (
    BODY_KINDS,
    ELASTIC,
    RIGID,
    FieldInertia,
    MassProperties,
    Pose,
    inertia_matrices,
    write_frame,
    write_weight,
)
from sparsemor.core import (
    Amplitude,
    Block,
    Body,
    BodyPlugin,
    Equations,
    FieldKind,
    FloatArray,
    FrameHistory,
    InputError,
    IntArray,
    ProbePlace,
    suggestions,
)

HELD: dict[str, list[int]] = {"clamp": [0, 1, 2], "chord": [0, 1, -2], "none": []}
"""Numbers of the unknowns that each reference condition fixes."""


class Beam(BodyPlugin):
    """Planar Euler-Bernoulli beam along the x axis of its frame. Points: left, middle, right."""

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    length: float = Field(gt=0)
    """Length, m."""
    area: float = Field(gt=0)
    """Area of the cross section, m2."""
    second_moment: float = Field(gt=0)
    """Second moment of area of the cross section, m4."""
    modulus: float = Field(gt=0)
    """Young's modulus, Pa."""
    density: float = Field(gt=0)
    """Density, kg/m3."""
    elements: int = Field(default=8, ge=2, multiple_of=2)
    """Number of elements, even."""
    damping: float = Field(default=0.0, ge=0)
    """Factor of the stiffness matrix in the damping matrix, s."""
    reference: Literal["clamp", "chord"] = "chord"
    """Displacements that are zero in the frame: `clamp`: all of the left end; `chord`: u and v of
    the left end, v of the right one."""
    fields: list[Literal["elastic"]] = ["elastic"]
    """A beam without its field is rigid."""
    frame: Literal["floating", "fixed"] = "floating"
    """`fixed`: the frame stays at its pose."""
    pose: Pose = Pose()
    """Left end, angle and their rates at the start."""

    @property
    def selected_fields(self) -> Sequence[str]:
        return self.fields

    def build(self, name: str, base: Path) -> "BuiltBeam":
        pose, velocity = self.pose.in_plane()
        return BuiltBeam(name, pose, velocity, self, self.frame == "floating")


@dataclass(frozen=True)
class BuiltBeam(Body):
    """The built beam. velocity: rates of the pose; floats: its frame has unknowns, unless it
    follows the motion `guide`."""

    name: str
    pose: FloatArray
    velocity: FloatArray
    beam: Beam
    floats: bool
    guide: FrameHistory | None = None

    # ------------------------------------------------------------------ unknowns and equations

    def blocks(self) -> Sequence[Block]:
        moves = self.floats and self.guide is None
        return [Block(self.name, RIGID, 3 * moves), Block(self.name, ELASTIC, len(self.free))]

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        zero = np.zeros(len(self.free))
        return {f"{self.name}.rigid": (self.pose, self.velocity),
                f"{self.name}.elastic": (zero, zero)}

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        return {f"{self.name}.elastic": (self.nodes[self.free // 3], self.free % 3)}

    def contribute(self, equations: Equations) -> None:
        write_frame(equations, self, self.mass, self.inertia if self.flexible else None)
        if self.flexible:
            block, K = f"{self.name}.elastic", csr_array(self.stiffness)
            equations.matrix(block, block, A=K, B=self.beam.damping * K)

    def gravity(self, equations: Equations, g: FloatArray, amplitude: Amplitude) -> None:
        write_weight(equations, self, self.mass, g, amplitude,
                     self.inertia.first if self.flexible else None)

    # ------------------------------------------------------------------ motion and points

    def with_motion(self, motion: FrameHistory) -> "BuiltBeam":
        return replace(self, guide=motion)

    def rigid_copy(self) -> "BuiltBeam":
        return replace(self, beam=self.beam.model_copy(update={"fields": []}))

    @property
    def extent(self) -> float:
        return self.beam.length

    def point_of(self, which: str, key: str) -> FloatArray:
        return self.nodes[self._node(which, key)]

    def displacement_of(self, which: str) -> FloatArray | None:
        return self._at(which, [0, 1]) if self.flexible else None

    def rotation_of(self, which: str, key: str) -> FloatArray | None:
        return self._at(which, [2]) if self.flexible else None

    def deforms_at(self, which: str) -> bool:
        return self.flexible and self._at(which, [0, 1, 2]).any()

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace:
        if not isinstance(at, str):
            raise InputError("give the name of a point: left, middle or right", "at")
        return ProbePlace(name, self.name, self.point_of(at, "at"), self.displacement_of(at), None,
                          (), self.pose, self.guide)

    def _node(self, which: str, key: str) -> int:
        n = self.beam.elements
        points = {"left": 0, "middle": n // 2, "right": n}
        if which not in points:
            raise InputError(f"beam {self.name!r} has no point {which!r}: "
                             f"{suggestions(which, list(points), 'points')}", key)
        return points[which]

    def _at(self, which: str, components: list[int]) -> FloatArray:
        """Columns of the identity for unknowns of a node, zero for fixed ones."""
        numbers = 3 * self._node(which, "on") + np.array(components)
        return (self.free[:, None] == numbers).astype(np.float64)

    # ------------------------------------------------------------------ integrals over the axis

    @property
    def nodes(self) -> FloatArray:
        x = np.linspace(0.0, self.beam.length, self.beam.elements + 1)
        return np.stack([x, 0.0 * x], axis=1)

    @property
    def free(self) -> IntArray:
        """Numbers 3 node + component of the unknowns."""
        n = 3 * (self.beam.elements + 1)
        held = np.array(HELD[self.beam.reference], dtype=np.int64) % n
        return np.setdiff1d(np.arange(n), held) if self.beam.fields else np.zeros(0, np.int64)

    @property
    def mass(self) -> MassProperties:
        m, L = self.beam.density * self.beam.area * self.beam.length, self.beam.length
        return MassProperties(m, np.array([m * L / 2, 0.0]), np.diag([m * L**2 / 3, 0.0]))

    @cached_property
    def inertia(self) -> FieldInertia:
        """first = int rho A N^T dx, about_g = int rho A N^T B_g X dx, M_g = int rho A N^T B_g N dx;
        four points are exact for degree 7."""
        b, B = self.beam, inertia_matrices(self.pose)
        n, h = 3 * (b.elements + 1), b.length / b.elements
        first, about, M = np.zeros((n, 2)), np.zeros((n, len(B))), np.zeros((len(B), n, n))
        points, weights = np.polynomial.legendre.leggauss(4)
        for e in range(b.elements):
            at = slice(3 * e, 3 * e + 6)
            for s, w in zip(0.5 + 0.5 * points, 0.5 * h * b.density * b.area * weights,
                            strict=True):
                N, X = shape_functions(s, h), np.array([(e + s) * h, 0.0])
                first[at] += w * N.T
                about[at] += w * N.T @ (B @ X).T
                M[:, at, at] += w * N.T @ B @ N
        F = self.free
        return FieldInertia(first[F], about[F], [csr_array(m[np.ix_(F, F)]) for m in M])

    @cached_property
    def stiffness(self) -> FloatArray:
        b = self.beam
        n, h = 3 * (b.elements + 1), b.length / b.elements
        axial, bending = b.modulus * b.area / h, b.modulus * b.second_moment / h**3
        own = np.zeros((6, 6))
        own[np.ix_([0, 3], [0, 3])] = axial * np.array([[1, -1], [-1, 1]])
        own[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = bending * np.array([
            [12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
        K = np.zeros((n, n))
        for e in range(b.elements):
            K[3 * e : 3 * e + 6, 3 * e : 3 * e + 6] += own
        return K[np.ix_(self.free, self.free)]


def shape_functions(s: float, h: float) -> FloatArray:
    """Displacement (2, 6) at the fraction s of an element of length h, m, by (u, v, theta) of both
    ends."""
    N = np.zeros((2, 6))
    N[0, [0, 3]] = 1 - s, s
    N[1, [1, 2, 4, 5]] = (1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3),
                          3 * s**2 - 2 * s**3, h * (s**3 - s**2))
    return N
