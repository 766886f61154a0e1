"""Link with two bores: the body of the double pendulum of Liang et al. 2026, Sec. 4.1."""

from math import isqrt
from pathlib import Path

import numpy as np
from pydantic import Field, field_validator, model_validator

from sparsemor.bodies.mesh.generators.rectangle import grid_quads, shorter_diagonal, split_quads
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, MeshPlugin, MeshSize

REGULAR = 1280
AROUND, RADIAL, ALONG = 8, 5, 40
"""Numbers of quads of the regular mesh: per quarter of a bore's edge, across its ring, along the
middle."""
COARSE = 320
COARSE_QUADS = 4, 3, 16
"""Numbers of quads, as above, of a coarse mesh for trials: a quarter of the triangles, 16 nodes on
a bore's edge."""


class Link(MeshPlugin):
    """Link: a bar with a round bore near each of its square ends, meshed by triangles.

    The origin is the centre of bore A. Each square end is a ring of quads around its bore, the part
    between is a regular block; every quad is split along its shorter diagonal. Bore A is at (0, 0),
    bore B at (length, 0).

    Sets: bore_a, bore_b (their edges), top, bottom, left, right, and the single points chord_a
    (right-most of bore A) and chord_b (left-most of bore B).
    """

    length: float = Field(default=1.0, gt=0)
    """Distance between the bores' centres, m; more than the height."""
    height: float = Field(default=0.17, gt=0)
    """Height of the bar, m."""
    bore: float = Field(default=0.085, gt=0)
    """Diameter of the bores, m; less than the height."""
    elements: int = Field(default=REGULAR, ge=1)
    """Number of triangles: 1280 r^2 with a whole number r, or 320 for trials."""

    @field_validator("elements")
    @classmethod
    def _square_multiple(cls, elements: int) -> int:
        """Raises InputError for a number of triangles that is neither 1280 r^2 nor 320."""
        r = isqrt(elements // REGULAR)
        if elements in (COARSE, REGULAR * r * r):
            return elements
        possible = (COARSE, *(REGULAR * k * k for k in (max(r, 1), r + 1)))
        nearest = min(possible, key=lambda n: abs(n - elements))
        raise InputError(
            f"{elements} triangles cannot be made; the link has 320 or 1280 r^2 of "
            f"them (1280, 5120, 11520, 20480, ...): take {nearest}"
        )

    @model_validator(mode="after")
    def _fits(self) -> "Link":
        if not self.bore < self.height < self.length:
            raise InputError(
                f"bore {self.bore:g}, height {self.height:g}, length {self.length:g} m do not make "
                "a link: the bore must be smaller than the height, the height than the length"
            )
        return self

    def expected(self) -> MeshSize:
        around, radial, along = self._quads()
        rings, middle = 2 * (radial + 1) * 4 * around, (along - 1) * (around + 1)
        return MeshSize(rings + middle, 2 * (8 * around * radial + around * along), 2)

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used. around, radial, along: numbers of quads per quarter of a
        bore's edge, across its ring, along the middle; a, b, block: numbers of the points of both
        rings (rows from the bore outwards) and of the block between them."""
        around, radial, along = self._quads()
        ring = _ring(self.bore / 2, self.height / 2, around, radial)
        x = np.linspace(self.height / 2, self.length - self.height / 2, along + 1)[1:-1]
        y = ring[-1, : around + 1, 1]
        middle = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)
        points = np.concatenate([
            ring.reshape(-1, 2), ring.reshape(-1, 2) + [self.length, 0.0], middle.reshape(-1, 2)
        ])
        a, b, block = _numbers(around, radial, along)
        quads = np.concatenate([grid_quads(n) for n in (_closed(a), _closed(b), block)])
        # The middle block's quads are rectangles, so ties decide there. Every second row leans the
        # other way: one lean everywhere would bend the bar to one side, and a checkerboard gives
        # edge points unequal areas, which overshoots under a surface flux. Columns and rings have
        # an even number of quads, so odd numbers are the odd rows.
        leaning = np.arange(quads.shape[0]) % 2 == 0
        cells = split_quads(quads, shorter_diagonal(points, quads, leaning))
        return Mesh(points, cells, self._sets(points, a, b))

    def _quads(self) -> tuple[int, int, int]:
        """Numbers of quads per quarter of a bore's edge, across its ring, along the middle."""
        if self.elements == COARSE:
            return COARSE_QUADS
        r = isqrt(self.elements // REGULAR)
        return AROUND * r, RADIAL * r, ALONG * r

    def _sets(self, points: FloatArray, a: IntArray, b: IntArray) -> dict[str, IntArray]:
        """Sets of nodes: the edges, the bores and the two ends of the chord. a, b (radial + 1, 4
        around): point numbers of the rings, row 0 on the bore, from -45 degrees on."""
        x, y = points.T
        half, near = self.height / 2, 1e-9 * self.length
        half_side = a.shape[1] // 8
        edges = {
            "top": y > half - near, "bottom": y < near - half,
            "left": x < near - half, "right": x > self.length + half - near,
        }
        sets = {name: np.flatnonzero(inside) for name, inside in edges.items()}
        sets |= {"bore_a": np.sort(a[0]), "bore_b": np.sort(b[0])}
        return sets | {"chord_a": a[0, [half_side]], "chord_b": b[0, [5 * half_side]]}


def _ring(radius: float, half: float, around: int, radial: int) -> FloatArray:
    """(radial + 1, 4 around, 2) points of a ring between circle and square, m, counter-clockwise
    from -45 degrees.

    One quarter is computed and rotated by exact right angles, so the ring is exactly symmetric.
    """
    s = np.arange(-around // 2, around // 2) / (around // 2)
    circle = radius * np.stack([np.cos(s * np.pi / 4), np.sin(s * np.pi / 4)], axis=1)
    side = half * np.stack([np.ones(around), s], axis=1)
    share = np.linspace(0.0, 1.0, radial + 1)[:, None, None]
    quarter = (1 - share) * circle + share * side
    turned = [quarter]
    for _ in range(3):
        turned.append(np.stack([-turned[-1][..., 1], turned[-1][..., 0]], axis=2))
    return np.concatenate(turned, axis=1)


def _numbers(around: int, radial: int, along: int) -> tuple[IntArray, IntArray, IntArray]:
    """Point numbers of ring A, ring B and the middle block, which shares its end columns with the
    rings."""
    a = np.arange((radial + 1) * 4 * around).reshape(radial + 1, -1)
    b = a + a.size
    inner = 2 * a.size + np.arange((along - 1) * (around + 1)).reshape(along - 1, -1)
    from_a = a[-1, : around + 1]
    from_b = b[-1, 2 * around : 3 * around + 1][::-1]
    return a, b, np.concatenate([from_a[None], inner, from_b[None]])


def _closed(ring: IntArray) -> IntArray:
    """Rows of point numbers (r, c) with their first point again at the end, (r, c + 1)."""
    return np.concatenate([ring, ring[:, :1]], axis=1)
