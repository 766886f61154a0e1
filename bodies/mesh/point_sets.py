"""Named sets of points: defined in a scene, used by joints and loads; and surfaces whose border
cuts facets: their measure compared with that of the facets in the set."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import model_validator

from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.bodies.fem.quadratic_cells import with_further
from sparsemor.bodies.mesh.cell_measures import triangulated
from sparsemor.bodies.mesh.coordinate_expressions import ConditionText, evaluate_condition
from sparsemor.bodies.mesh.set_centres import centre_of_set
from sparsemor.core import (
    BoolArray,
    Fault,
    FloatArray,
    Gather,
    InputError,
    IntArray,
    Mesh,
    Plugin,
    suggestions,
)
from sparsemor.core.model.facets import outer_facets


class PointSet(Plugin):
    """Named set of mesh points, by exactly one of `box`, `where` and `nearest`; or the centre of a
    set of the mesh file."""

    box: list[tuple[float, float]] | None = None
    """Box [[x0, x1], [y0, y1]], with [z0, z1] in 3-D, m: the points inside, boundary included."""
    where: ConditionText | None = None
    """Condition in x, y, z (m), such as `y > 0.08 and x < 0.5`."""
    nearest: list[float] | None = None
    """Position [x, y] or [x, y, z], m: the nearest point of the mesh (the lowest number on a tie).
    """

    ways: ClassVar[tuple[str, ...]] = ("box", "where", "nearest")
    centre: list[float] | None = None
    """Centre of the set, m (body axes), for joints, forces, torques and probes on it, instead of
    the mean of its facets or the centre of the circle or cylinder on which they lie. Without `box`,
    `where` and `nearest`: of the set of this name in the mesh."""

    @model_validator(mode="after")
    def _one(self) -> "PointSet":
        """Raises InputError unless exactly one way is given, or the centre alone."""
        options = [name for name in self.ways if getattr(self, name) is not None]
        if len(options) != 1 and (options or self.centre is None):
            raise InputError(
                f"{' and '.join(options) or 'nothing'} given; a point set takes exactly one of "
                f"{', '.join(self.ways)}"
            )
        if any(low > high for low, high in self.box or ()):
            raise InputError(f"box {self.box}: each pair is [lower, upper]", "box")
        return self

    def members(self, mesh: Mesh) -> IntArray:
        """Sorted numbers of the corners of a mesh that are in the set; InputError when there are
        none, or for another dimension."""
        if self.nearest is not None:
            found = self._nearest(mesh)
        else:
            found = np.flatnonzero(self.contains(mesh.corners, mesh))
        if not found.size:
            low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
            extent = " x ".join(f"[{a:.6g}, {b:.6g}]" for a, b in zip(low, high, strict=True))
            raise InputError(f"no point of the mesh is in this set; the mesh fills {extent} m")
        return found

    @property
    def only_centre(self) -> bool:
        """True for the centre of a set that the mesh has."""
        return all(getattr(self, name) is None for name in self.ways)

    def contains(self, points: FloatArray, mesh: Mesh) -> BoolArray:
        """(n,) True for the positions (n, d), m, on a mesh that `box` or `where` contains."""
        if self.where is not None:
            return evaluate_condition(self.where, points, "where")
        _same_dimension(len(self.box or ()), mesh, "box")
        low, high = np.array(self.box).T
        # round-off must not decide whether a point on the border is in
        slack = 1e-9 * float(np.ptp(mesh.points, axis=0).max())
        inside = (points >= low - slack) & (points <= high + slack)
        return np.asarray(inside.all(axis=1))

    def _nearest(self, mesh: Mesh) -> IntArray:
        _same_dimension(len(self.nearest or ()), mesh, "nearest")
        distance = np.linalg.norm(mesh.corners - np.array(self.nearest), axis=1)
        return np.array([np.argmin(distance)])


def with_sets(mesh: Mesh, sets: Mapping[str, PointSet]) -> Mesh:
    """Copy of the mesh with the given sets added, with the nodes between their corners; one that
    gives a centre alone is a set that the mesh must have. InputError, with all faults, with keys
    `<name>` or `<name>.box`."""
    found: dict[str, IntArray] = {}
    faults: list[Fault] = []
    for name, declared in sets.items():
        if declared.only_centre:
            if name not in mesh.point_sets:
                faults.append(Fault(name, "the mesh has no set of this name: "
                                    f"{suggestions(name, sorted(mesh.point_sets), 'sets')}; or "
                                    "say which points are in it by box, where or nearest"))
            continue
        if name in mesh.point_sets:
            faults.append(Fault(name, f"the mesh has a set '{name}' already: take another name"))
            continue
        try:
            found[name] = with_further(mesh, declared.members(mesh))
        except InputError as error:
            faults.extend(error.under(name).faults)
    if faults:
        raise InputError(faults)
    return replace(mesh, point_sets={**mesh.point_sets, **found})


def given_centres(mesh: Mesh, sets: Mapping[str, PointSet]) -> dict[str, FloatArray]:
    """Set -> centre (d,), m, where the scene gives it; InputError with keys `<name>.centre` for one
    that the set cannot have."""
    found: dict[str, FloatArray] = {}
    gather = Gather()
    for name, declared in sets.items():
        if declared.centre is not None:
            found[name] = np.array(declared.centre, dtype=np.float64)
            gather("", _check_centre, mesh, name, found[name])
    gather.check()
    return found


def _check_centre(mesh: Mesh, name: str, point: FloatArray) -> None:
    """Raises InputError for a centre (d,), m, that the set cannot have."""
    _same_dimension(len(point), mesh, f"{name}.centre")
    try:
        centre_of_set(mesh, mesh.point_sets[name], point, name)
    except InputError as error:
        raise error.under(f"{name}.centre") from None


def find_set(mesh: Mesh, name: str, key: str) -> IntArray:
    """Point numbers of a named set; InputError under `key` with the names of the existing sets."""
    if name in mesh.point_sets:
        return mesh.point_sets[name]
    advice = "" if mesh.point_sets else "; declare it under `sets`"
    raise InputError(f"the mesh has no set {name!r}: "
                     f"{suggestions(name, sorted(mesh.point_sets), 'sets')}{advice}", key)


def _same_dimension(count: int, mesh: Mesh, key: str) -> None:
    """Raises InputError unless so many coordinates are those of the mesh's dimension."""
    if count != mesh.dimension:
        raise InputError(f"{count} coordinates given for a {mesh.dimension}-D mesh", key)


SAMPLES = {2: 64, 3: 8}
"""Parts of an edge (in space: of each side of a triangle) at whose centres a condition is
evaluated."""
SAME_SIDE = 0.7
"""Smallest cosine of the angle between facets that belong to the same side of a body."""


def cut_measures(mesh: Mesh, declared: PointSet, facets: IntArray) -> tuple[float, float]:
    """Length (m) or area (m2) of the facets (F, d) of a set, and of the patch of the surface that
    its `box` or `where` describes there.

    Facets next to them on the same side of the body, with some corners in the set and some not, are
    the cut ones: the share of each that is in the patch is found by sampling. Same side: the normal
    is near to that of the set at a common corner (`SAME_SIDE`).
    """
    outer, facets = triangulated(outer_facets(mesh)), triangulated(facets)
    inside = np.isin(outer, facets)
    ours = area_vectors(mesh.points[facets]) / (mesh.dimension - 1)
    total = float(np.linalg.norm(ours, axis=1).sum())
    cut_facets = outer[inside.any(axis=1) & ~inside.all(axis=1)]
    if not len(cut_facets) or (declared.box is None and declared.where is None):
        return total, total
    # unit normals of the facets of the set, gathered at their corners
    sums = np.zeros_like(mesh.points)
    np.add.at(sums, facets, ours[:, None])
    normals = area_vectors(mesh.points[cut_facets]) / (mesh.dimension - 1)
    size = np.linalg.norm(normals, axis=1)
    set_normals = sums[cut_facets]
    length = np.linalg.norm(set_normals, axis=2)
    sizes = np.maximum(length * size[:, None], 1e-300)
    cosine = np.einsum("fkd,fd->fk", set_normals, normals) / sizes
    cut_facets, size = (a[(cosine > SAME_SIDE).any(axis=1)] for a in (cut_facets, size))
    if not len(cut_facets):
        return total, total
    weights = _weights(mesh.dimension)
    samples = np.einsum("sk,fkd->fsd", weights, mesh.points[cut_facets])
    try:
        found = declared.contains(samples.reshape(-1, mesh.dimension), mesh)
        found = found.reshape(len(cut_facets), -1)
    except InputError:  # the condition is defined at nodes only
        return total, total
    return total, total + float(size @ found.mean(axis=1))


def _weights(d: int) -> FloatArray:
    """(S, d) barycentric coordinates of the centres of equal parts of a facet."""
    n = SAMPLES[d]
    if d == 2:
        x = (np.arange(n) + 0.5) / n
        return np.stack([1 - x, x], axis=1)
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(n) for j in range(n - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(n) for j in range(n - i - 1)]
    xy = np.array(upright + turned) / n
    return np.column_stack([1 - xy.sum(axis=1), xy])
