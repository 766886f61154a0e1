"""The unknowns that a contact in space works with, in the order that it counts them.

The local unknowns are, in this order: the first frame's, the second's, the displacements of the
first surface's points and of the second's; those that a side does not have are left out.
Temperatures of the first surface's points and of the second's come after them.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """How many local unknowns are of which kind: frames f1, f2, displacements u1, u2; and points
    n1, n2 of the surfaces."""

    f1: int
    f2: int
    u1: int
    u2: int
    n1: int
    n2: int

    @classmethod
    def of(cls, first: Side, second: Side) -> "Sizes":
        return cls(len(first.frame), len(second.frame), len(first.u), len(second.u),
                   len(first.surface.nodes), len(second.surface.nodes))

    @property
    def whole(self) -> int:
        return self.f1 + self.f2 + self.u1 + self.u2

    @property
    def frames(self) -> int:
        return self.f1 + self.f2

    def split(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """x (whole,) by kind, displacements as (n, 3), zero where there are none."""
        a, b = self.f1, self.frames
        c = b + self.u1
        u1 = x[b:c].reshape(-1, 3) if self.u1 else np.zeros((self.n1, 3))
        u2 = x[c:].reshape(-1, 3) if self.u2 else np.zeros((self.n2, 3))
        return x[:a], x[a:b], u1, u2

    def places(self, first: IntArray, second: IntArray) -> IntArray:
        """Which of the local unknowns, and of the temperatures after them, some points have."""
        one, two = self.frames, self.frames + self.u1
        parts = [np.arange(self.frames)]
        if self.u1:
            parts.append((one + 3 * first[:, None] + np.arange(3)).ravel())
        if self.u2:
            parts.append((two + 3 * second[:, None] + np.arange(3)).ravel())
        return np.concatenate([*parts, self.whole + first, self.whole + self.n1 + second])

    def touched(self, numbers: IntArray) -> tuple[BoolArray, BoolArray]:
        """(n1,), (n2,): points of which an unknown has a place in numbers (local + n1 + n2,)."""
        some = numbers >= 0
        _, _, u1, u2 = self.split(some[: self.whole].astype(np.float64))
        T = some[self.whole :]
        return u1.any(axis=1) | T[: self.n1], u2.any(axis=1) | T[self.n1 :]
