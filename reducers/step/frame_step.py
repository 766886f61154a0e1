"""One body of a mechanical step: what it brings to the border."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import EvaluatesManyTimes, FloatArray, Frame, FrameHistory, FrameWork
from sparsemor.reducers.step.elastic_block import ElasticBlock
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.prescribed_frame_block import PrescribedBlock
from sparsemor.reducers.step.time_tables import TimeTable

NONE = np.zeros(0)


def buffers(frames: Sequence[Frame]) -> list[FrameWork]:
    """Arrays for each frame to fill."""
    return [FrameWork(f.p, f.border, f.generators) for f in frames]


@dataclass(frozen=True, slots=True, eq=False)
class BodyStep:
    """One body in the loop: its kernel, its map to the border, and where its unknowns sit.

    elastic_name, rigid_name: blocks of its displacements and rigid coordinates, "" where it has
    none; block: its elastic rows with a border; prescribed: where there is none, and `table` what
    time alone decides of them."""

    name: str
    frame: Frame
    to_border: FloatArray
    origin: FloatArray
    block: ElasticBlock | None
    elastic: slice
    thermal: slice
    elastic_name: str
    guide: FrameHistory | None = None
    rigid_name: str = ""
    prescribed: PrescribedBlock | None = None
    table: TimeTable | None = None

    @property
    def free(self) -> bool:
        """True if its frame is unknown."""
        return bool(self.to_border[: self.frame.rigid_size].any())

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        tested: TestedElastic | None, c: FloatArray, r1: FloatArray, r2: FloatArray, t: float,
        work: FrameWork,
    ) -> None:
        """The frame at border unknowns y and rates v, a (b,), with the functionals and forms of
        coefficients c (k,) and their r1, r2; tested: None for a rigid body."""
        if tested is None:
            self.frame.evaluate(y, v, a, c1, c2, NONE, NONE, NONE, NONE, NONE, t, work)
            return
        F, Q = tested.functional, tested.quadratic
        form, forms = Q.dot(c).dot(c), np.concatenate((Q.dot(r1).dot(c), Q.dot(r2).dot(c)))
        self.frame.evaluate(
            y, v, a, c1, c2, F.dot(c), F.dot(r1), F.dot(r2), form, forms, t, work)

    def border_motion(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(b,) each: what the map leaves out of border unknowns and their rates at t, s."""
        if self.guide is None:
            zero = np.zeros(len(self.origin))
            return self.origin, zero, zero
        return self._filled(*self.guide.at(t))

    def border_motion_along(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(T, b) each: the same at times (T,), s."""
        if self.guide is None:
            zero = np.zeros((len(times), len(self.origin)))
            return zero + self.origin, zero, zero
        return self._filled(*self.guide.along(times))

    def _filled(
        self, pose: FloatArray, rate: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of what the guide prescribes, (..., n): with the rest of the border."""
        n, b = pose.shape[-1], len(self.origin)
        if n == b:
            return self.origin + pose, rate, acceleration
        y, v, a = (np.zeros((*pose.shape[:-1], b)) for _ in range(3))
        y += self.origin
        for values, part in ((y, pose), (v, rate), (a, acceleration)):
            values[..., :n] += part
        return y, v, a


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedFactors:
    """Factors of a prescribed frame in steps with these c1 and c2: times (T,) -> kappa, mu, sigma,
    which do not depend on displacements (core/protocols/separable.py), (T, 2 g + p)."""

    body: BodyStep
    c1: float
    c2: float

    def __call__(self, times: FloatArray) -> FloatArray:
        frame = self.body.frame
        if len(times) == 1 or not isinstance(frame, EvaluatesManyTimes):
            work, = buffers([frame])
            return np.array([self._at(t, work) for t in times.tolist()])
        return frame.drive_along(*self.body.border_motion_along(times), self.c1, self.c2, times)

    def _at(self, t: float, work: FrameWork) -> FloatArray:
        self.body.frame.drive(*self.body.border_motion(t), self.c1, self.c2, t, work)
        return np.concatenate((work.coefficients[:-1], work.sigma[-1]))
