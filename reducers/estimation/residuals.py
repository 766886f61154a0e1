"""Residuals of reduced states in the full-order equations of one block, on the modes of its errors.

They are the equations of reducers/step/projected_operators.py with the modes as test basis, at many
states at once. Their cost grows with the numbers of atoms and modes, not with the mesh.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.reducers.step.frame_step import BodyStep, PrescribedFactors
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat
from sparsemor.reducers.step.time_tables import LoadsInTime


class Trajectory(NamedTuple):
    """Reduced states of a run: times (j,), s; unknowns x and rates v, a (j, n)."""

    times: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class HeatResidual:
    """Residual of a thermal block: C T' + K T - loads(t) on q modes, with the constant part among
    the loads. at: its unknowns; operators (2 k, q): transposes of [K | C]."""

    at: slice
    operators: FloatArray
    loads: LoadsInTime

    @classmethod
    def from_operators(cls, at: slice, b: ProjectedHeat) -> "HeatResidual":
        return cls(at, np.ascontiguousarray(np.hstack([b.conductivity, b.capacity]).T),
                   LoadsInTime(b.constant, b.loads, tuple(b.amplitudes), tuple(b.tables)))

    def __call__(self, run: Trajectory) -> FloatArray:
        """Residuals (j, q) at the states of a run."""
        at = self.at
        return np.hstack([run.x[:, at], run.v[:, at]]) @ self.operators - self.loads(run.times)


@dataclass(frozen=True, slots=True, eq=False)
class ElasticResidual:
    """Residual of an elastic block on q modes, with the terms of its frame, whose motion is
    prescribed (reducers/step/projected_operators.py).

    step: its frame and ranges of unknowns; tested: its operators, multiplied by the q modes;
    operators ((3 + g) k + p + kT, q): transposes of stiffness, damping, mass, g generators, p
    directions and minus the coupling with kT temperatures; loads: what is subtracted, by time.
    """

    step: BodyStep
    tested: ProjectedElastic
    operators: FloatArray
    loads: LoadsInTime

    @classmethod
    def from_operators(cls, step: BodyStep, b: ProjectedElastic) -> "ElasticResidual":
        columns = [b.stiffness, b.damping, b.mass, *b.generators, b.directions, -b.coupling]
        # to be subtracted; `constant` is on the left-hand side (`ProjectedElastic`)
        loads = LoadsInTime(-b.constant, b.loads, tuple(b.amplitudes), tuple(b.tables))
        return cls(step, b, np.ascontiguousarray(np.hstack(columns).T), loads)

    def __call__(self, run: Trajectory) -> FloatArray:
        """Residuals (j, q) at the states of a run, one product with all operators. kappa, mu
        (j, g): factors of the generators times c and c'; sigma (j, p): of the directions."""
        e, g, b = self.step.elastic, len(self.tested.generators), self.tested
        c, v, a = run.x[:, e], run.v[:, e], run.a[:, e]
        factors = PrescribedFactors(self.step)(run.times)
        kappa, mu, sigma = factors[:, :g], factors[:, g : 2 * g], factors[:, 2 * g :]
        inertia = [kappa[:, i, None] * c + mu[:, i, None] * v for i in range(g)]
        heat = [run.x[:, self.step.thermal]] if b.coupling.size else []
        return np.hstack([c, v, a, *inertia, sigma, *heat]) @ self.operators - self.loads(run.times)
