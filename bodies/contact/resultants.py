"""Resultants of a contact at some times: what a history keeps of it."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.contact.pieces import Overlaps, Pieces
from sparsemor.bodies.contact.tractions import Interface, Samples, nodal
from sparsemor.core.arrays import FloatArray, IntArray

HISTORIES = ("normal", "friction", "power", "length", "pressure")


class Resultants:
    """Sums over pieces at `steps` times."""

    def __init__(self, steps: int) -> None:
        self._normal, self._friction = np.zeros(steps, complex), np.zeros(steps, complex)
        self._power, self._length, self._pressure = (np.zeros(steps) for _ in range(3))

    def add(self, time: IntArray, overlaps: Overlaps, pieces: Pieces, face: Interface) -> None:
        """time (N,): number of the time of each piece."""
        q = nodal(overlaps, pieces, face, None)[2]
        W = (pieces.stop - pieces.start)[:, None] * face.weights
        push = q.p * q.measure * W
        np.add.at(self._normal, time, (push * q.t).sum(axis=1))
        np.add.at(self._friction, time, (push * q.ratio * q.t).sum(axis=1))
        np.add.at(self._power, time, (push * q.ratio * q.slip).sum(axis=1))
        span = (pieces.stop - pieces.start) * q.measure[:, 0] / face.width
        np.add.at(self._length, time, np.where(push.any(axis=1), span, 0.0))
        ends = np.stack([pieces.start, pieces.stop], axis=1)
        top = Samples.at(overlaps, pieces.of, ends, face).p.max(axis=1, initial=0.0)
        np.maximum.at(self._pressure, time, top)

    def found(self) -> Mapping[str, FloatArray]:
        """(steps,) each: "normal" and "friction" N, the sizes of the resultants of pressure and of
        friction; "power" W; "length" m in contact; "pressure" Pa, the largest."""
        values = (np.abs(self._normal), np.abs(self._friction), self._power, self._length,
                  self._pressure)
        return dict(zip(HISTORIES, values, strict=True))
