"""Energy that an integrator of first order takes from a motion, against the motion's own."""

from collections.abc import Mapping, Sequence
from math import sqrt

import numpy as np
from pydantic import PrivateAttr

from sparsemor.core import (
    BoolArray,
    Check,
    Findings,
    FloatArray,
    Model,
    Note,
    OnStep,
    PreparedRun,
    RunResult,
    State,
    information,
)
from sparsemor.plugins.checks import place
from sparsemor.plugins.checks.unresolved_motion import ROUNDING, inner_force

ENERGY_LOST = "energy_lost"
"""Kind of the note."""
LIMIT, WARNED = 0.05, 0.1
"""Energy lost, relative to the largest kinetic energy, above which a note, or a warning, says
so."""
STATES = 40
"""Number of states from which the loss is summed."""
INERTIA = 0.01
"""Largest inertia force on a body, relative to the largest other one, below which it stands still
but for its load: no motion of its own can lose energy."""
FEWEST = 20
"""Number of steps below which a run shows no loss: it is that of its first step."""
LARGEST = 20_000
"""Number of full-order unknowns above which it is not looked at."""


class EnergyLost(Check):
    """Energy that an integrator of first order takes from a motion."""

    order = place("energy_lost")
    _times: frozenset[int] = frozenset()
    _states: list[State] = PrivateAttr(default_factory=list)

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        """Function that keeps the states at `times_of_energy`; None where there is no estimate: of
        integrators of second order, without moving frames, for parts of a run (not whole), large
        models, and runs with other loads than the model's or controllers (not own_loads)."""
        model, scene = run.model, run.scene
        if not whole or model is None or not run.own_loads or scene.time.control is not None or (
                scene.integrator.order > 1 or model.layout.frames.stop == 0
                or model.layout.size > LARGEST):
            return None
        self._times = times_of_energy(run.steps)
        return self._look

    def _look(
        self, done: int, before: State, state: State, active: Mapping[str, BoolArray]
    ) -> None:
        if done in self._times:
            self._states.append(state)

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        h = run.scene.time.step
        lost = None if run.model is None or not self._states else energy_lost(
            run.model, [run.full_order(s) for s in self._states], h, run.steps)
        return Findings(energy_notes(lost, h), {"energy_lost": lost})


def times_of_energy(steps: int) -> frozenset[int]:
    """Numbers of the steps whose states are looked at: multiples of the golden ratio modulo the
    run, which keep step with no period of the motion; the first and the last one among them."""
    golden = 0.5 * (sqrt(5.0) - 1.0)
    return frozenset({steps, *(1 + int(steps * (i * golden % 1.0)) for i in range(STATES))}) if (
        steps) else frozenset()


def energy_lost(model: Model, states: Sequence[State], h: float, steps: int) -> float | None:
    """Energy that implicit Euler takes from the motion in so many steps of h (s), relative to the
    largest kinetic energy of the rigid motion; None where nothing moves, or only as slowly as loads
    change (`INERTIA`), and for short runs.

    A step takes (1/2) dv^T M dv of the kinetic energy, dv = h a, and -(1/2) dx^T df of the
    potential one, df = M da: its sum over the run is that of the first part without the change of
    (h/2) v^T M a from the first to the last state. Together that is the share (w h)^2 a step for a
    vibration of the angular frequency w, and 1/n in n steps of a fall from rest. states: full-order
    ones, evenly spread, with the first and the last one.
    """
    if steps < FEWEST:
        return None
    lost, most, inertia, other = 0.0, 0.0, 0.0, 0.0
    at, changes = model.layout.frames, list[float]()
    for s in states:
        of_v, of_a, rest = _forces(model, s)  # M v, M a, largest force of another kind
        most = max(most, 0.5 * float(s.v[at] @ of_v))
        lost += h * h * float(s.a[at] @ of_a)  # of a step: twice the kinetic part
        inertia = max(inertia, float(np.abs(of_a).max(initial=0.0)))
        other = max(other, rest)
        changes.append(float(s.a[at] @ of_v))
    if not most > 0.0 or not np.isfinite(lost + most) or inertia < INERTIA * other:
        return None
    if inertia <= ROUNDING * inner_force(model, lambda name: states[-1].x[model.layout[name]]):
        return None  # a settling of bodies that deform
    # mean loss of a step times their number, less the change of (h/2) v^T M a
    return max(0.0, lost / len(states) * steps - 0.5 * h * (changes[-1] - changes[0])) / most


def _forces(model: Model, s: State) -> tuple[FloatArray, FloatArray, float]:
    """M v and M a of the frames (m,), with the mass matrix M of a state, as inertia forces are
    linear in accelerations; and the largest force of one term on a frame without inertia, N or
    N m. Terms that act on no frame are not evaluated."""
    at, most = model.layout.frames, 0.0
    found = np.zeros((2, at.stop))
    with np.errstate(all="ignore"):
        for term in model.terms:
            on = term.rows < at.stop
            if not on.any():
                continue
            j, frames = term.columns, term.columns < at.stop
            rest = term.residual(s.x[j], s.v[j], 0.0 * s.a[j], s.t)[on]
            most = max(most, float(np.abs(rest).max(initial=0.0)))
            for forces, u in zip(found, (s.v, s.a), strict=True):
                moved = term.residual(s.x[j], s.v[j], np.where(frames, u[j], 0.0), s.t)[on]
                np.add.at(forces, term.rows[on], moved - rest)
    return found[0], found[1], most


def energy_notes(lost: float | None, h: float) -> tuple[Note, ...]:
    """Note on a large loss. lost: of `energy_lost`; h: time step, s."""
    if lost is None or not lost > LIMIT:
        return ()
    takes = (f"the integrator takes energy from the motion: in this run about {100.0 * lost:.2g} % "
             "of the largest kinetic energy")
    if lost <= WARNED:
        return (information(f"{takes}; one of second order (generalized_alpha, bdf2) takes less",
                            ENERGY_LOST),)
    return (Note(f"{takes} (noted above {100.0 * LIMIT:g} %): take one of second order "
                 f"(generalized_alpha, bdf2), or a step much smaller than {h:g} s", ENERGY_LOST),)
