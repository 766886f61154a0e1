"""Reference conditions: fixed displacements that remove the rigid-body modes from a body's
deformation."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import model_validator

from sparsemor.bodies.fem.elasticity import rigid_modes
from sparsemor.bodies.mesh.mesh_checks_and_repairs import LARGEST
from sparsemor.bodies.mesh.point_sets import find_set
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, Plugin


class Reference(Plugin):
    """Reference condition: fixes displacements in the body frame so that they contain no rigid
    motion."""

    chord: tuple[str, str] | tuple[str, str, str] | None = None
    """One-point sets, two in the plane, three in space: u = 0 at the first, no displacement normal
    to their line at the second, none normal to their plane at the third."""
    clamp: str | None = None
    """Set whose points do not move in the body frame."""
    hold: dict[str, Literal["x", "y", "z", "xy", "xz", "yz", "xyz"]] | None = None
    """Sets and the components of u that are zero there (body axes), such as {hub: xy, back: z}: for
    a body that is supported by parts that move with its frame."""

    @model_validator(mode="after")
    def _one(self) -> "Reference":
        if [self.chord, self.clamp, self.hold].count(None) != 2:
            raise InputError("a reference condition is one of `chord` (two sets, three in space), "
                             "`clamp` (one) and `hold` (sets with components)")
        return self

    def fixed(self, mesh: Mesh) -> IntArray:
        """Sorted numbers d node + component of the fixed displacements."""
        if self.clamp is not None:
            return self._clamped(mesh, self.clamp)
        if self.hold is not None:
            return self._components(mesh, self.hold)
        assert self.chord is not None
        return self._chord(mesh, self.chord)

    @staticmethod
    def _clamped(mesh: Mesh, name: str) -> IntArray:
        """Displacements of the nodes of a set, all components. Raises InputError where the body
        could still turn."""
        d, nodes = mesh.dimension, find_set(mesh, name, "reference.clamp")
        if len(nodes) < 2:
            raise InputError(
                f"set {name!r} is a single point: a clamp needs two or more, or the body still "
                "turns about it", "reference.clamp")
        if d == 3 and on_a_line(mesh.points[nodes]):
            raise InputError(
                f"the points of set {name!r} lie on one line: the body still turns about it; clamp "
                "a set that spans a plane", "reference.clamp")
        return np.sort((d * nodes[:, None] + np.arange(d)).ravel())

    @staticmethod
    def _components(mesh: Mesh, hold: Mapping[str, str]) -> IntArray:
        """Numbers d node + component of the displacements of some components of sets (set ->
        letters of axes). Raises InputError with the number of rigid motions that remain; those of a
        body of revolution are checked elsewhere."""
        d, found = mesh.dimension, [np.zeros(0, np.int64)]
        for name, components in hold.items():
            key = f"reference.hold.{name}"
            nodes = find_set(mesh, name, key)
            which = ["xyz".index(c) for c in components]
            if max(which) >= d:
                raise InputError(f"the mesh is plane: there is no z (got {components})", key)
            found += [d * nodes + i for i in which]
        fixed = np.unique(np.concatenate(found))
        free = 0 if mesh.revolved else free_motions(mesh.points, fixed)
        if free:
            raise InputError(f"the body still has {free} rigid motion{'s' * (free > 1)}: hold more "
                             "components, or more points", "reference.hold")
        return fixed

    @staticmethod
    def _chord(mesh: Mesh, chord: Sequence[str]) -> IntArray:
        """Displacements that hold the ends of a chord on its line, the first one at its place, in
        space three points in their plane, to the nearest components in body axes (`chord_holds`).
        InputError for sets of several points, or points that do not determine them."""
        d = mesh.dimension
        if len(chord) != d:
            raise InputError(f"a chord is {d} one-point sets in {d}-D (got {len(chord)})",
                             "reference.chord")
        ends = [find_set(mesh, s, "reference.chord") for s in chord]
        for name, nodes in zip(chord, ends, strict=True):
            if len(nodes) != 1:
                raise InputError(
                    f"set {name!r} has {len(nodes)} points: a chord end is one point; declare one "
                    f"in sets, as in {{end: {{nearest: {[0.0] * d}}}}}", "reference.chord")
        points = [int(e[0]) for e in ends]
        if points[0] == points[1]:
            extent = float(np.ptp(mesh.points, axis=0).max())
            raise InputError(
                "the two ends of the chord are the same point of the mesh, which is "
                f"{extent:.4g} m long" + (": is it in millimetres (`scale: 1.0e-3`)?"
                                          if extent >= LARGEST else ""), "reference.chord")
        if d == 3 and on_a_line(mesh.points[points]):
            raise InputError("the three points of the chord lie on one line", "reference.chord")
        return chord_holds(mesh.points[points], points)


def free_motions(X: FloatArray, fixed: IntArray) -> int:
    """Number of rigid-body modes of points X (N, d) with zero displacements `fixed`."""
    modes = rigid_modes(X)
    return int(modes.shape[1] - np.linalg.matrix_rank(modes[fixed], tol=1e-8))


def chord_holds(X: FloatArray, points: list[int]) -> IntArray:
    """Sorted numbers d node + component of the displacements that a chord of d points X (d, d)
    fixes.

    At the second point all components except the one closest to the line, at the third the one
    closest to the normal of the plane.
    """
    d = X.shape[1]
    along = int(np.argmax(np.abs(X[1] - X[0])))
    fixed = [d * points[0] + i for i in range(d)]
    fixed += [d * points[1] + i for i in range(d) if i != along]
    if d == 3:
        normal = np.abs(np.cross(X[1] - X[0], X[2] - X[0]))
        fixed.append(3 * points[2] + int(np.argmax(normal)))
    return np.sort(np.array(fixed))


def on_a_line(X: FloatArray) -> bool:
    """True if points (n, 3) are collinear, to 1e-8 of their extent."""
    size = np.linalg.svd(X - X.mean(axis=0), compute_uv=False)
    return bool(len(size) < 2 or size[1] <= 1e-8 * size[0])
