"""Deflection of rotational springs in space beyond what the quaternions of their sides tell."""

from collections.abc import Iterator, Mapping

import numpy as np

from sparsemor.core import (
    BoolArray,
    Check,
    OnStep,
    PreparedRun,
    SolveFailed,
    State,
    Status,
)
from sparsemor.plugins.checks import place

ADVICE = ("frame: spinning of rigid bodies counts all turns about the axis z; elsewhere leave out "
          "the stiffness, or keep the deflection within 2 pi")


class SpringTurns(Check):
    """Deflections of rotational springs in space beyond those that their sides tell."""

    order = place("spring_turns")

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        angles = SpringAngles(run, state)
        return angles.lost if angles.readers else None


class SpringAngles:
    """Deflections of rotational springs in space from their relaxed angle at the last step of a
    run.

    They are continuous between -2 pi and 2 pi and jump by 4 pi there, where the force of the spring
    is wrong from then on.
    """

    def __init__(self, run: PreparedRun, state: State) -> None:
        self.readers = tuple(r for r in run.forces if r.bounded_angle(state) is not None)
        self.last = list(self._angles(state))

    def lost(
        self, done: int, before: State, state: State, active: Mapping[str, BoolArray]
    ) -> SolveFailed | None:
        """Failure of a run in whose last step, that ends at `state`, an angle has jumped."""
        for i, angle in enumerate(self._angles(state)):
            last, self.last[i] = self.last[i], angle
            if abs(angle - last) > 2.0 * np.pi:
                beyond = angle + np.copysign(4.0 * np.pi, last)
                return SolveFailed(
                    Status.OUTSIDE_THEORY, state.t, self.readers[i].name,
                    f"the spring is deflected by {beyond:.4g} rad; in space this is known between "
                    "-2 pi and 2 pi only", advice=ADVICE)
        return None

    def _angles(self, state: State) -> Iterator[float]:
        for r in self.readers:
            if (angle := r.bounded_angle(state)) is not None:
                yield float(angle[0])
