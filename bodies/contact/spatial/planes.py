"""The planes of triangles, and the linear functions of their corners."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Of facets b (F, 3, 3): a corner (F, 3), the outward unit normal n (F, 3), and the gradients
    of the three corners' linear functions g (F, 3, 3), 1/m, which lie in the facet's plane."""

    corner: FloatArray
    n: FloatArray
    g: FloatArray

    @classmethod
    def of(cls, b: FloatArray) -> Self:
        p, q = b[:, 1] - b[:, 0], b[:, 2] - b[:, 0]
        N = np.cross(p, q)
        size = (N * N).sum(axis=1, keepdims=True)
        g1, g2 = np.cross(q, N) / size, np.cross(N, p) / size
        return cls(b[:, 0], N / np.sqrt(size), np.stack([-g1 - g2, g1, g2], axis=1))

    def some(self, chosen: IntArray) -> "Planes":
        return Planes(self.corner[chosen], self.n[chosen], self.g[chosen])
