"""Check of the initial accelerations: a second-order integrator would carry them over a whole
step."""

from dataclasses import replace

import numpy as np

from sparsemor.core import (
    AssembledModel,
    InputError,
    Integrator,
    State,
    Status,
    StepFormula,
    StepOutcome,
    consistent_state,
)
from sparsemor.reducers.step.rejection import checked, rejected_step


def check_start(model: AssembledModel, integrator: Integrator, h: float) -> None:
    """Raises InputError where x + h v + h^2 a / 2 at the start takes a surface through another one
    and x + h v does not.

    A load that presses touching surfaces together gives them the acceleration of free flight. It
    lasts until the contact is compressed, a small fraction of a step of h (s), but a second-order
    integrator assumes it for the whole step.
    """
    if integrator.order < 2:
        return
    start = consistent_state(model)
    why = _objection(model, h, start)
    if why and not _objection(model, h, replace(start, a=np.zeros_like(start.a))):
        fast = float(np.abs(start.a[model.layout.second]).max())
        raise InputError(
            f"a second-order integrator begins with the accelerations at the start, up to "
            f"{fast:.3g} m/s2 or rad/s2, which last only until the contact is compressed. Carried "
            f"over one step of {h:g} s: {why}. Take integrator: bdf1 (where the scene has two "
            "stages, rigid_stage: {overrides: {integrator: bdf1}}), let the load begin "
            "from zero (a ramp), or let the surfaces overlap by their static depth at the start",
            "integrator")


def _objection(model: AssembledModel, h: float, start: State) -> str:
    """Message of the terms that reject the state after h (s) at constant acceleration, "" if none
    does."""
    layout, x, v, a = model.layout, start.x, start.v, start.a
    second = np.zeros(layout.size)
    second[layout.second] = 1.0
    end = x + second * (h * v + 0.5 * h * h * a)
    c1 = 1.0 / h
    step = StepFormula(start.t + h, c1, c1 * c1, c1, layout, 0.0 * x, 0.0 * x)
    found = rejected_step(
        StepOutcome(end, Status.DONE, 0, rates=(v + h * a, a)),
        checked((t, t.columns) for t in model.terms), step)
    return "" if found.status.ok else found.detail
