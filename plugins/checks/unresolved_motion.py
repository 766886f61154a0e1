"""Motions and forces that the steps do not resolve: joint forces that alternate from step to step,
rotations of free bodies and springs in space, and impacts of a few steps."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from sparsemor.core import (
    BoolArray,
    Check,
    Findings,
    FloatArray,
    Model,
    Note,
    OnStep,
    PreparedRun,
    Quantity,
    RunResult,
    Scene,
    SolveFailed,
    State,
    Status,
)
from sparsemor.core.protocols.layout import joints_with_forces
from sparsemor.core.protocols.poses import FREE_POSE, angle_between
from sparsemor.plugins.checks import place

LAST = 20
"""Number of steps at the end of a run that are examined."""
LIMIT = 0.1
"""Amplitude, relative to the joint's largest force, above which there is a warning."""
SMALL, ROUNDING = 1e-6, 1e-9
"""Joint forces below the first share of the largest in the scene are round-off, and those below the
second one of stiffness times displacement, the size of the forces in a body that cancel there."""
DIED_OUT = 1e-3
"""Joint forces that have fallen below this share of the joint's largest of the run do not count."""


class AlternatingJointForces(Check):
    """Joint forces that alternate from step to step, without physical meaning."""

    order = place("alternating_joint_forces")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(alternating_forces(run.model, result))


def alternating_forces(model: Model | None, result: RunResult) -> tuple[Note, ...]:
    """Warning for each joint whose stored forces alternate about their mean course over the last
    steps; none if not every step was stored, or too few."""
    if result.scene["output"]["every"] != 1 or len(result.times) < LAST + 3:
        return ()
    last = slice(len(result.times) - LAST - 2, len(result.times))
    blocks = {name: result.layout.multipliers(name) for name in joints_with_forces(result.layout)}
    forces = {name: result.block(b.name) for name, b in blocks.items() if b is not None}
    size = {name: float(np.abs(f[last]).max()) for name, f in forces.items()}
    most = max(size.values(), default=0.0)
    share_of = {name: alternation(f[last]) for name, f in forces.items()
             if size[name] > max(SMALL * most, DIED_OUT * float(np.abs(f).max()))}
    if max(share_of.values(), default=0.0) <= LIMIT or most <= ROUNDING * inner_force(
            model, lambda name: result.block(name, slice(last.stop - 1, last.stop))):
        return ()
    return tuple(Note(
        f"the forces of joint {name} alternate from step to step, by {100 * share:.3g} % of their "
        f"size over the last {LAST} steps: they are not physical; take bdf2, or generalized_alpha "
        "with a smaller rho_inf (0.8 or less), and a smaller time.step where that does not help",
        "alternating_forces") for name, share in share_of.items() if share > LIMIT)


def inner_force(model: Model | None, displacements: Callable[[str], FloatArray]) -> float:
    """Largest stiffness of an elastic block times its largest displacement, N; 0.0 without bodies
    that deform. displacements: block -> its full-order unknowns."""
    return max((
        float(np.abs(model.block_data(b.name).stiffness.diagonal()).max(initial=0.0))
        * float(np.abs(displacements(b.name)).max(initial=0.0))
        for b in model.layout if b.kind.quantity is Quantity.DISPLACEMENT and b.size),
        default=0.0) if model is not None else 0.0


def alternation(forces: FloatArray) -> float:
    """Largest amplitude of the alternating part of joint forces (m, l) in m steps, relative to
    their largest absolute value.

    The second differences of a sequence c + (-1)^k A are 4 A in size and change sign in every step.
    A component counts if all its second differences change sign; their median gives its amplitude.
    """
    bends = forces[2:] - 2.0 * forces[1:-1] + forces[:-2]
    flips = np.all(bends[1:] * bends[:-1] < 0.0, axis=0)
    size = float(np.abs(forces).max(initial=0.0))
    if not flips.any() or size == 0.0:
        return 0.0
    return float(np.median(np.abs(bends[:, flips]), axis=0).max() / (4.0 * size))


LARGEST_TURN = 1.0
"""Rotation in a step, rad, above which there is a warning."""
BRAKED = 0.01
"""Share of a spin lost over the run above which there is a warning."""


class FreeRotations(Check):
    """Rotations of free bodies in space that the step does not resolve, or the integrator
    brakes."""

    order = place("free_rotations")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(tuple(rotation_notes(run.scene, result)))


def rotation_notes(scene: Scene, result: RunResult) -> Iterator[Note]:
    """Warnings about bodies with a unit quaternion: turns by more than a radian in a step, and the
    share of their spin that an integrator of first order takes, (w h)^2 / 8 in each step."""
    h = scene.time.step
    for block in result.layout:
        if (block.kind.quantity is not Quantity.POSE or block.size != FREE_POSE
                or len(result.times) < 2 or scene.time.control is not None):
            continue
        pose = result.block(block.name)
        if not np.isfinite(pose).all():
            continue
        steps = np.diff(result.times) / h  # between stored states
        turns = angle_between(pose[:-1], pose[1:]) / steps
        if (most := float(turns.max())) > LARGEST_TURN:
            yield Note(
                f"{block.owner} turns by {most:.3g} rad in a step of {h:.3g} s: the step does not "
                f"resolve its rotation; take time.step of at most {0.2 * h / most:.2g} s",
                "unresolved_rotation")
        lost = 1.0 - float(np.exp(-(turns**2 / 8.0 * steps).sum()))
        if scene.integrator.order == 1 and lost > BRAKED:
            yield Note(
                f"the integrator brakes the spin of {block.owner}, by about {100.0 * lost:.2g} % "
                "over the run: take one of second order (generalized_alpha, bdf2), or frame: "
                "spinning where the axis is fixed", "braked_spin")


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
    is wrong from then on. readers: force elements whose angle is known between these limits only;
    last: their angles, rad.
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


FEWEST = 10
"""Number of steps of an impact from which its speeds are resolved."""


class ShortImpacts(Check):
    """Impacts that the steps do not resolve: of a force element that acts at times only."""

    order = place("short_impacts")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """Warnings about force elements whose shortest impact takes less than `FEWEST` steps."""
        every, h = run.scene.output.every, run.scene.time.step
        forces = result.joint_forces()
        shortest = dict[str, int]()
        for name, (what, unit) in result.element_forces.items():
            found = list(impacts(forces[name][what, unit]))
            if found:  # a force at n stored steps acts for less than n + 1 intervals between them
                shortest[name] = (min(found) + 1) * every - 1
        return Findings([Note(
            f"{name} acts for {steps} step{'s' if steps > 1 else ''} and no longer, which its "
            f"impact takes {FEWEST} or more of: bodies leave it with wrong speeds, and may gain "
            f"energy. Take time.step of at most {h * steps / FEWEST:.2g} s, or less stiffness",
            "short_impact") for name, steps in shortest.items() if steps < FEWEST])


def impacts(force: FloatArray) -> Iterator[int]:
    """Numbers of stored steps of each time that a force acts, between two times without it."""
    edges = np.flatnonzero(np.diff((force != 0.0).astype(np.int8), prepend=0, append=0))
    for first, end in edges.reshape(-1, 2).tolist():
        if first > 0 and end < len(force):
            yield end - first
