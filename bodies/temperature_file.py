"""Temperatures of another code, from a file: at points and at times, interpolated to nodes.

    T(node, t) = sum_p W(node, p) T_p(t) = sum_k f_k(t) shape_k(node)

W is a linear fit to the nearest points, exact where a node is one of them and for temperatures that
are linear in space (moving least squares: Lancaster and Salkauskas 1981, doi
10.1090/S0025-5718-1981-0616367-1). In time they are linear between those of the file, constant
before and after. The sum over k, a singular value decomposition, has as many terms as the
temperatures need, whatever the number of nodes.
"""

import csv
import xml.etree.ElementTree as ElementTree
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from sparsemor.core import FloatArray, InputError, IntArray, Plugin, TimeFunction
from sparsemor.core.protocols.load_tables import places

NEAREST = {2: 8, 3: 14}
"""Dimension -> number of points of the fit at a node."""
SAME, DISTANT, RANK = 1e-9, 0.1, 1e-12
"""Distance of a node and a point that are the same, and largest one by default, relative to the
size of the body; singular values that are left out, relative to the largest."""
CELSIUS = 273.15
"""0 degrees Celsius, K."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples(TimeFunction):
    """Piecewise linear function of time with values (T,) at times (T,), s; constant outside. rate:
    slope, from the right at one of the times; jumps: times at which it may have a kink."""

    times: FloatArray
    values: FloatArray

    def value(self, t: float) -> float:
        i, w = (a[0] for a in places(self.times, np.array([t])))
        return float(self.values[i] + w * (self.values[min(i + 1, len(self.times) - 1)]
                                           - self.values[i]))

    def rate(self, t: float) -> float:
        i = bisect_right(self.times, t)
        if not 0 < i < len(self.times):
            return 0.0
        return float((self.values[i] - self.values[i - 1]) / (self.times[i] - self.times[i - 1]))

    def curvature(self, t: float) -> float:
        return 0.0

    def jumps(self, start: float, end: float) -> Sequence[float]:
        times: list[float] = self.times.tolist()
        return times[bisect_left(times, start) : bisect_right(times, end)]


@dataclass(frozen=True, slots=True, eq=False)
class NodalTemperatures:
    """Temperatures (T, n), K, of n nodes at times (T,), s. distance: largest one of a node to the
    nearest point of the file, m."""

    times: FloatArray
    values: FloatArray
    distance: float

    def separated(self) -> list[tuple[TimeFunction, FloatArray]]:
        """Functions f_k of time with their shapes (n,), whose sum of products it is."""
        U, s, V = np.linalg.svd(self.values, full_matrices=False)
        return [(Samples(self.times, U[:, k] * s[k]), V[k])
                for k in range(max(1, int((s > RANK * s[0]).sum())))]


class TemperatureFile(Plugin):
    """Temperatures of another code from a file.

    npz: arrays `points` (P, d), `times` (T,) and one named as `quantity` (T, P). csv: a line of
    names, first x, y (and z), then the times in s; a line of coordinates and temperatures for each
    point. vtu: one time. pvd: a series of vtu files with their times, as ParaView writes it.
    """

    path: str = Field(min_length=1)
    """The file, relative to the scene's folder."""
    quantity: str = "temperature"
    """Name of the temperatures in npz, vtu and pvd files."""
    unit: Literal["K", "degC"] = "K"
    """Unit of the temperatures in the file."""
    scale: float = Field(default=1.0, gt=0)
    """Metres per length unit of the file."""
    distance: float | None = Field(default=None, gt=0)
    """Largest distance, m, of a node from the nearest point of the file; a tenth of the size of
    the body when not given."""

    def files(self, base: Path) -> tuple[Path, ...]:
        """The file and those that it lists: their content identifies a run."""
        own = base / self.path
        listed = [f for _, f in _listed(own)] if own.suffix == ".pvd" and own.is_file() else []
        return own, *listed

    def at(self, base: Path, X: FloatArray, size: float) -> NodalTemperatures:
        """Temperatures at nodes X (n, d), m, of a body of this size, m; InputError under `path`.

        A reader returns points (P, 2 or 3) in the unit of the file, times (t,), s, and temperatures
        T (t, P). W (n, k): weights of the k points nearest to each node; away: largest distance, m.
        """
        full = base / self.path
        readers = {".npz": self._npz, ".csv": _csv, ".vtu": self._vtu, ".pvd": self._pvd}
        if full.suffix not in readers:
            raise InputError(f"'{self.path}' is none of {', '.join(readers)}", "path")
        if not full.is_file():
            raise InputError(
                f"there is no file '{self.path}'; paths start at the folder of the scene", "path")
        try:
            points, times, T = readers[full.suffix](full)
        except (KeyError, ValueError, IndexError, OSError, ElementTree.ParseError) as error:
            raise InputError(f"'{self.path}' cannot be read: {error}", "path") from None
        self._check(points, times, T, X.shape[1])
        points = points[:, : X.shape[1]] * self.scale
        away = self.distance or DISTANT * size
        distance, near = cKDTree(points).query(X, min(NEAREST[X.shape[1]], len(points)))
        distance, near = distance.reshape(len(X), -1), near.reshape(len(X), -1)
        if distance[:, 0].max() > away:
            far = int(distance[:, 0].argmax())
            where = ", ".join(f"{c:.6g}" for c in X[far])
            raise InputError(
                f"'{self.path}': the node at ({where}) m is {distance[far, 0]:.3g} m from the "
                f"nearest of its points, farther than {away:.3g} m: give its length unit as "
                "`scale`, or a larger `distance`", "path")
        W = _fit(points[near] - X[:, None], distance, SAME * size)
        kelvin = CELSIUS if self.unit == "degC" else 0.0
        return NodalTemperatures(times, np.einsum("nk,tnk->tn", W, T[:, near]) + kelvin,
                                 float(distance[:, 0].max()))

    def _check(self, points: FloatArray, times: FloatArray, T: FloatArray, d: int) -> None:
        """Raises InputError for points, times and temperatures T (times, points) that do not fit
        each other or the body."""
        fault = ""
        if points.ndim != 2 or points.shape[1] not in (d, 3) or not len(points):
            fault = f"points of shape {points.shape}, and the body has {d} coordinates"
        elif points.shape[1] > d and np.ptp(points[:, 2]) > 0.0:
            fault = "points that differ in z, and the body is plane"
        elif T.shape != (len(times), len(points)) or times.ndim != 1 or not len(times):
            fault = (f"temperatures of shape {T.shape} at {times.size} times and {len(points)} "
                     "points: they need a row for each time")
        elif not all(np.isfinite(a).all() for a in (points, times, T)):
            fault = "numbers that are not finite"
        elif (np.diff(times) <= 0).any():
            fault = "times that do not increase"
        elif (T + (CELSIUS if self.unit == "degC" else 0.0) < 0.0).any():
            fault = f"temperatures below absolute zero: {T.min():.4g} {self.unit}"
        if fault:
            raise InputError(f"'{self.path}' has {fault}", "path")

    def _npz(self, full: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
        with np.load(full, allow_pickle=False) as held:
            P, t, T = (np.asarray(held[name], dtype=np.float64)
                       for name in ("points", "times", self.quantity))
        return P, np.atleast_1d(t), np.atleast_2d(T)

    def _vtu(self, full: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
        import meshio

        mesh = meshio.read(full)
        if self.quantity not in mesh.point_data:
            raise ValueError(f"{full.name} has no data of points named {self.quantity!r}, but "
                             f"{', '.join(sorted(mesh.point_data)) or 'none'}")
        return (np.asarray(mesh.points, dtype=np.float64), np.zeros(1),
                np.asarray(mesh.point_data[self.quantity], dtype=np.float64).reshape(1, -1))

    def _pvd(self, full: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Temperatures at the points of the first file; those of others may have moved."""
        found = [(t, *self._vtu(file)) for t, file in sorted(_listed(full))]
        points = found[0][1]
        return points, np.array([f[0] for f in found]), np.concatenate([f[3] for f in found])


def _listed(full: Path) -> list[tuple[float, Path]]:
    return [(float(s.attrib["timestep"]), full.parent / s.attrib["file"])
            for s in ElementTree.parse(full).iter("DataSet")]


def _csv(full: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    with full.open(newline="", encoding="utf-8-sig") as file:
        head, *rows = (row for row in csv.reader(file) if row)
    d = sum(name.strip().lower() in ("x", "y", "z") for name in head)
    values = np.array(rows, dtype=np.float64)
    return values[:, :d], np.array(head[d:], dtype=np.float64), values[:, d:].T


def _fit(offsets: FloatArray, distance: FloatArray, same: float) -> FloatArray:
    """Weights (n, k) of the k nearest points, offsets (n, k, d), m, in a linear fit at n nodes; the
    least squares are weighted by 1 / distance^2, and where points are on a line or plane, those of
    the smallest slope."""
    size = np.maximum(distance[:, -1:], same)
    root = 1.0 / np.maximum(distance / size, 1e-6)
    A = np.concatenate([np.ones((*distance.shape, 1)), offsets / size[:, :, None]], axis=2)
    W: FloatArray = np.linalg.pinv(root[:, :, None] * A, rcond=1e-6)[:, 0] * root
    at: IntArray = np.flatnonzero(distance[:, 0] <= same)
    W[at] = np.eye(distance.shape[1])[0]
    return W
