"""Initial state of the first step: consistent, without accelerations that the step cannot
resolve."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sparsemor.core.model.initial_state import consistent_state, euler_state
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import Integrator, State
from sparsemor.core.protocols.layout import Quantity

FAR = 0.1
"""Displacement by constant acceleration over one step, relative to the diagonal of the body, from
which the step does not resolve the acceleration."""


class ResolvedStart(NamedTuple):
    """Initial state, and the largest acceleration that was set to zero, m/s2 or rad/s2 (0: none).
    shaken: body with vibrations that the step does not resolve, whose accelerations are those of an
    implicit Euler step ("": none), and `far`, the displacement that they would have made, m."""

    state: State
    dropped: float
    shaken: str = ""
    far: float = 0.0

    def notes(self, h: float) -> tuple[Note, ...]:
        """Note on accelerations that a step of h (s) does not resolve; none where there are none.
        """
        if self.shaken:
            return (information(
                f"the vibrations of {self.shaken} at the start are much faster than the step of "
                f"{h:g} s: their accelerations over one step would displace it by {self.far:.2g} "
                "m; the first step begins with those of an implicit Euler step, which damps them. "
                "To resolve them take smaller steps; to avoid them let loads begin from zero (a "
                "ramp) and initial temperatures fit the reference temperature", "start"),)
        return () if self.dropped == 0.0 else (information(
            f"the accelerations at the start, up to {self.dropped:.3g} m/s2 or rad/s2, last only "
            f"until a contact is compressed, much less than the step of {h:g} s: the first step "
            "begins without them. To resolve that motion take smaller steps, or let the load begin "
            "from zero (a ramp)", "start"),)


def resolved_start(model: Model, integrator: Integrator, h: float) -> ResolvedStart:
    """The consistent initial state, with zero accelerations where x + h v + h^2 a / 2 takes a
    surface through another one and x + h v does not, here or in the rigid-body pre-simulation.

    A load that presses touching surfaces together gives them the acceleration of free flight, which
    lasts until the contact is compressed, a small part of a step of h (s). An integrator of order
    two would assume it for the whole step. Without it the first step has an error of O(h^2), so
    that the order is kept, and ends near the compressed contact.

    Elastic vibrations that the step does not resolve, such as those of a body that is hot at the
    start, are damped by stiffly stable integrators. Their accelerations, constant over a long step,
    are no motion: a multiple of the size of the body, with velocities at which the nonlinear terms
    of frames and joints blow up. Then the state has the accelerations of an implicit Euler step.
    """
    start = consistent_state(model)
    if integrator.order < 2:
        return ResolvedStart(start, 0.0)
    still = replace(start, a=np.zeros_like(start.a))
    if model.stage is not None and model.stage.dropped:
        return ResolvedStart(still, model.stage.dropped)
    if _passes(model, start, h) and not _passes(model, still, h):
        return ResolvedStart(still, float(np.abs(start.a[model.layout.second]).max()))
    shaken, far = _farthest(model, start, h)
    if shaken:
        return ResolvedStart(euler_state(model, h), 0.0, shaken, far)
    return ResolvedStart(start, 0.0)


def _farthest(model: Model, start: State, h: float) -> tuple[str, float]:
    """Body that h^2 a / 2 displaces by more than `FAR` of its size, the farthest, and that
    displacement, m; "", 0 if there is none."""
    found, name, most = 0.0, "", FAR
    for b in model.layout:
        if b.kind.quantity is Quantity.DISPLACEMENT and b.name in model.geometry:
            points = model.geometry[b.name][0]
            size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
            far = 0.5 * h * h * float(np.abs(start.a[model.layout[b.name]]).max(initial=0.0))
            if far > most * size > 0.0:
                found, name, most = far, b.owner, far / size
    return name, found


def _passes(model: Model, start: State, h: float) -> bool:
    """True if a term rejects the state after h (s) at constant acceleration."""
    second = np.zeros(model.layout.size)
    second[model.layout.second] = 1.0
    x = start.x + second * (h * start.v + 0.5 * h * h * start.a)
    v = start.v + h * start.a
    return any(term.check_step(x[term.columns], v[term.columns], start.t + h, h)
               for term in model.terms if term.rejects)
