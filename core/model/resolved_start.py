"""Initial state of the first step: consistent, without accelerations that the step cannot
resolve."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import ChecksStep, Integrator, State


class ResolvedStart(NamedTuple):
    """Initial state, and the largest acceleration that was set to zero, m/s2 or rad/s2 (0: none).
    """

    state: State
    dropped: float

    def notes(self, h: float) -> tuple[Note, ...]:
        """Note on accelerations that a step of h (s) does not resolve; none where there are none.
        """
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
    """
    start = consistent_state(model)
    if integrator.order < 2:
        return ResolvedStart(start, 0.0)
    still = replace(start, a=np.zeros_like(start.a))
    if model.stage is not None and model.stage.dropped:
        return ResolvedStart(still, model.stage.dropped)
    if _passes(model, start, h) and not _passes(model, still, h):
        return ResolvedStart(still, float(np.abs(start.a[model.layout.second]).max()))
    return ResolvedStart(start, 0.0)


def _passes(model: Model, start: State, h: float) -> bool:
    """True if a term rejects the state after h (s) at constant acceleration."""
    second = np.zeros(model.layout.size)
    second[model.layout.second] = 1.0
    x = start.x + second * (h * start.v + 0.5 * h * h * start.a)
    v = start.v + h * start.a
    return any(term.check_step(x[term.columns], v[term.columns], start.t + h, h)
               for term in model.terms if isinstance(term, ChecksStep))
