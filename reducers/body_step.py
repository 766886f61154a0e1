"""One body of a mechanical step: what it brings to the border."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.separable import Frame, FrameWork
from sparsemor.core.stage import FrameHistory
from sparsemor.reducers.driven_block import DrivenBlock
from sparsemor.reducers.elastic import ElasticBlock
from sparsemor.reducers.known import Known


@dataclass(frozen=True, slots=True, eq=False)
class BodyStep:
    """One body in the loop: its kernel, its map to the border, and where its unknowns sit.

    block: its elastic rows beside a border; driven: where there is none, and `known` what time
    alone decides of them (driven.py)."""

    name: str
    frame: Frame
    to_border: FloatArray
    origin: FloatArray
    block: ElasticBlock | None
    elastic: slice
    thermal: slice
    elastic_name: str
    guide: FrameHistory | None = None
    driven: DrivenBlock | None = None
    known: Known | None = None

    @property
    def free(self) -> bool:
        """Whether its frame is unknown."""
        return bool(self.to_border[: self.frame.rigid_size].any())

    def given(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(b,) each: what the map leaves out of border unknowns and their rates at t, s."""
        if self.guide is None:
            zero = np.zeros(len(self.origin))
            return self.origin, zero, zero
        return self._filled(*self.guide.at(t))

    def given_along(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(T, b) each: the same at times (T,), s."""
        if self.guide is None:
            zero = np.zeros((len(times), len(self.origin)))
            return zero + self.origin, zero, zero
        return self._filled(*self.guide.along(times))

    def _filled(
        self, pose: FloatArray, rate: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of what the guide tells, (..., n): with the rest of the border."""
        n, b = pose.shape[-1], len(self.origin)
        if n == b:
            return self.origin + pose, rate, acceleration
        y, v, a = (np.zeros((*pose.shape[:-1], b)) for _ in range(3))
        y += self.origin
        for values, known in ((y, pose), (v, rate), (a, acceleration)):
            values[..., :n] += known
        return y, v, a


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A frame that is given, in steps with these c1 and c2: times (T,) -> kappa, mu, sigma, which
    do not depend on displacements (core/separable.py), (T, 2 g + p). work: scratch."""

    body: BodyStep
    c1: float
    c2: float
    work: FrameWork

    @classmethod
    def of(cls, body: BodyStep, c1: float, c2: float) -> "Drive":
        f = body.frame
        return cls(body, c1, c2, FrameWork(f.p, f.border, f.generators))

    def __call__(self, times: FloatArray) -> FloatArray:
        along = getattr(self.body.frame, "drive_along", None)
        if along is None or len(times) == 1:
            return np.array([self._at(t) for t in times.tolist()])
        rows: FloatArray = along(*self.body.given_along(times), self.c1, self.c2, times)
        return rows

    def _at(self, t: float) -> FloatArray:
        self.body.frame.drive(*self.body.given(t), self.c1, self.c2, t, self.work)
        return np.concatenate((self.work.coefficients[:-1], self.work.sigma[-1]))
