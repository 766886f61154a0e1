"""Rotations of free frames in space that the step does not resolve, or the integrator brakes."""

from collections.abc import Iterator

import numpy as np

from sparsemor.core import Check, Findings, Note, PreparedRun, Quantity, RunResult, Scene
from sparsemor.core.protocols.poses import FREE_POSE
from sparsemor.plugins.checks import place

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
        p = result.block(block.name)[:, 3:]
        if not np.isfinite(p).all():
            continue
        p = p / np.linalg.norm(p, axis=1, keepdims=True)
        steps = np.diff(result.times) / h  # between stored states
        half = np.arccos(np.abs((p[1:] * p[:-1]).sum(axis=1)).clip(0.0, 1.0))
        turns = 2.0 * half / steps
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
