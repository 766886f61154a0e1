"""One body in a mechanical step: evaluation of its frame equations and position of its unknowns.

The *border* unknowns y (b,) of a body are its rigid coordinates, then its joint forces: the border
of the bordered matrix of a step, whose interior are the displacements. kappa, mu and sigma are the
scalars by which the motion of the frame acts on the displacements (core/protocols/body_frame.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Frame, FrameHistory, Layout
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.separable import MovingBody
from sparsemor.reducers.linalg.active_columns import are_few
from sparsemor.reducers.step.projected_operators import ProjectedElastic
from sparsemor.reducers.step.time_tables import TimeTable

NONE = np.zeros(0)


def buffers(frames: Sequence[Frame]) -> list[FrameWork]:
    """Working arrays for the evaluation of each frame."""
    return [FrameWork(f.p, f.border, f.generators) for f in frames]


@dataclass(frozen=True, slots=True, eq=False)
class BodyStep:
    """One body in a mechanical step.

    frame: equations of the floating frame; to_border, origin: affine map of rigid coordinates and
    multipliers to the pose and attachment forces of this body; elastic, thermal: ranges of its
    unknowns; elastic_name: name of its block of displacements, "" where it has none; guide:
    prescribed motion.
    """

    name: str
    frame: Frame
    to_border: FloatArray
    origin: FloatArray
    elastic: slice
    thermal: slice
    elastic_name: str
    guide: FrameHistory | None = None

    @classmethod
    def from_body(cls, body: MovingBody, layout: Layout, frame: Frame | None = None) -> "BodyStep":
        """A body with the layout of a step; frame: its frame, if not that of full order."""
        none = slice(0, 0)
        return cls(
            body.name, frame or body.frame, body.to_border, body.origin,
            layout[body.elastic] if body.elastic else none,
            layout[body.thermal] if body.thermal in layout else none, body.elastic, body.guide)

    @property
    def free(self) -> bool:
        """True if the motion of its frame is unknown."""
        return bool(self.to_border[: self.frame.rigid_size].any())

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        operators: ProjectedElastic | None, c: FloatArray, cv: FloatArray, ca: FloatArray, t: float,
        work: FrameWork,
    ) -> None:
        """Evaluates the frame at border unknowns y (rigid coordinates, then joint forces) and rates
        v, a (b,), for elastic coefficients c (k,) with rates cv, ca: fills `work`, derivatives for
        dv = c1 dy, da = c2 dy. operators: projected elastic operators, None for a rigid body.

        Of the displacements the frame reads few numbers: P^T (c, c', c''), with P^T = `functional`
        (p, k), and the forms c.Q_g (c, c', c''), with Q_g = `quadratic` (g, k, k)."""
        if operators is None:
            self.frame.evaluate(y, v, a, c1, c2, np.zeros((3, 0)), NONE, t, work)
            return
        states = np.stack([c, cv, ca])
        Q, active = operators.quadratic, states
        use = np.flatnonzero(states.any(axis=0))
        if are_few(use, len(c)):  # of a complete basis: products with the active atoms alone
            Q, active = Q[:, use[:, None], use], states[:, use]
        # (3 g,): c.Q_g c of all g, then c.Q_g c', then c.Q_g c''
        forms = (Q.dot(active.T) * active[0][:, None]).sum(axis=1).T.ravel()
        self.frame.evaluate(
            y, v, a, c1, c2, states.dot(operators.functional.T), forms, t, work)

    def border_motion(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Prescribed part of the border unknowns and of their first and second rates at t (s), (b,)
        each."""
        if self.guide is None:
            zero = np.zeros(len(self.origin))
            return self.origin, zero, zero
        return self._filled(*self.guide.at(t))

    def border_motion_along(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Prescribed part of the border unknowns and of their first and second rates at times (T,),
        s; (T, b) each."""
        if self.guide is None:
            zero = np.zeros((len(times), len(self.origin)))
            return zero + self.origin, zero, zero
        return self._filled(*self.guide.along(times))

    def _filled(
        self, pose: FloatArray, rate: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Prescribed motion (..., n) extended to all b border unknowns, of which its n rigid
        coordinates are the first, by zeros; the constant part `origin` (b,) is added to the
        pose."""
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
    """Factors [kappa, mu, sigma] (T, 2 g + p) of a prescribed frame at times (T,), s, which do not
    depend on displacements u (core/protocols/body_frame.py): kappa, mu (g,) multiply the inertia
    matrices times u and u', sigma (p,) the directions of loads on u."""

    body: BodyStep

    @classmethod
    def table(cls, step: BodyStep, body: MovingBody, ahead: bool = True) -> TimeTable:
        """The factors as functions of time; if `ahead`, tabulated at the times of the prescribed
        motion or of the loads, else evaluated when they are needed."""
        times = np.zeros(0)
        if ahead and body.guide is not None:
            times = body.guide.times
        elif ahead and body.operators is not None and body.operators.tables:
            times = body.operators.tables[0].table.times
        return TimeTable.tabulate(cls(step), times)

    def __call__(self, times: FloatArray) -> FloatArray:
        frame = self.body.frame
        if len(times) == 1:
            work, = buffers([frame])
            return self._at(float(times[0]), work)[None]
        return frame.drive_along(*self.body.border_motion_along(times), times)

    def _at(self, t: float, work: FrameWork) -> FloatArray:
        self.body.frame.drive(*self.body.border_motion(t), t, work)
        return np.concatenate((work.coefficients[:-1], work.sigma[-1]))
