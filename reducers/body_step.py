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
        pose, rate, acceleration = self.guide.at(t)
        if len(pose) == len(self.origin):
            return self.origin + pose, rate, acceleration
        y, v, a = self.origin.copy(), np.zeros(len(self.origin)), np.zeros(len(self.origin))
        for values, known in ((y, pose), (v, rate), (a, acceleration)):
            values[: len(known)] += known
        return y, v, a


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A frame that is given, in steps with these c1 and c2: time -> kappa, mu (g,) each and sigma
    (p,), which do not depend on displacements (core/separable.py). work: scratch."""

    body: BodyStep
    c1: float
    c2: float
    work: FrameWork

    @classmethod
    def of(cls, body: BodyStep, c1: float, c2: float) -> "Drive":
        f = body.frame
        return cls(body, c1, c2, FrameWork(f.p, f.border, f.generators))

    def __call__(self, t: float) -> FloatArray:
        y, v, a = self.body.given(t)
        self.body.frame.drive(y, v, a, self.c1, self.c2, t, self.work)
        return np.concatenate((self.work.coefficients[:-1], self.work.sigma[-1]))
