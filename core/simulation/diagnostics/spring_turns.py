"""Deflection of rotational springs in space beyond what the quaternions of their sides tell."""

from collections.abc import Iterator, Sequence

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import State
from sparsemor.core.results.probes import ForceReader
from sparsemor.core.status import SolveFailed, Status

ADVICE = ("frame: spinning of rigid bodies counts all turns about the axis z; elsewhere leave out "
          "the stiffness, or keep the deflection within 2 pi")


class SpringTurns:
    """Deflections of rotational springs in space from their relaxed angle at the last step of a
    run.

    They are continuous between -2 pi and 2 pi and jump by 4 pi there, where the force of the spring
    is wrong from then on.
    """

    def __init__(self, readers: Sequence[ForceReader], state: State) -> None:
        self.readers = tuple(r for r in readers if _angle(r, state) is not None)
        self.last = list(self._angles(state))

    def lost(self, state: State) -> SolveFailed | None:
        """Failure of a run in whose last step, that ends at `state`, an angle has jumped."""
        for i, angle in enumerate(self._angles(state)):
            before, self.last[i] = self.last[i], angle
            if abs(angle - before) > 2.0 * np.pi:
                beyond = angle + np.copysign(4.0 * np.pi, before)
                return SolveFailed(
                    Status.OUTSIDE_THEORY, state.t, self.readers[i].name,
                    f"the spring is deflected by {beyond:.4g} rad; in space this is known between "
                    "-2 pi and 2 pi only", advice=ADVICE)
        return None

    def _angles(self, state: State) -> Iterator[float]:
        for r in self.readers:
            if (angle := _angle(r, state)) is not None:
                yield float(angle[0])


def _angle(reader: ForceReader, state: State) -> FloatArray | None:
    own, other = (state.x[None, e] if isinstance(e, slice) else e.along(np.array([state.t]))[0]
                  for e in reader.ends)
    return reader.law.bounded_angle(np.array([state.t]), own, other)
