"""Doubts about a finished run, as notes: surfaces that never met, which is most often a mistake of
the scene, contact forces that do not settle, joint forces that alternate, and temperatures that
nothing could cool to."""

import numpy as np

from sparsemor.core.joint_forces import alternating_forces
from sparsemor.core.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import ReportsPassage
from sparsemor.core.results import RunResult
from sparsemor.core.stage import FrameHistory
from sparsemor.core.undershoot import undershoot


def unmet(model: Model, result: RunResult) -> tuple[Note, ...]:
    """A note for each part with a method `missed(motion)` that has something to say of how the
    bodies moved, along the rigid stage where there was one, else in the stored steps; and for each
    with a method `unsettled(history)` that has of the contact's history at all steps, or whose
    surfaces pass each other in too few of them. A note for each joint whose forces alternate, and
    for each body whose temperature undershoots."""
    asked = [missed for part in model.parts.values()
             if (missed := getattr(part, "missed", None)) is not None]
    told = [str(missed(_motion(model, result))) for missed in asked]
    if model.stage is not None or result.scene["output"]["every"] == 1:
        told += [str(unsettled(history)) for name, history in result.contacts().items()
                 if (unsettled := getattr(model.parts[name], "unsettled", None)) is not None]
        told += [part.passage(_motion(model, result)) for part in model.parts.values()
                 if isinstance(part, ReportsPassage)]
    contacts = tuple(Note(text, "contact") for text in told if text)
    return (*contacts, *alternating_forces(result), *undershoot(model, result))


def _motion(model: Model, result: RunResult) -> dict[str, FrameHistory]:
    if model.stage is not None:
        return dict(model.stage.frames)
    moved = {b.owner: result.block(b.name) for b in result.layout if b.field == "rigid"}
    return {name: FrameHistory(result.times, pose, np.zeros_like(pose), np.zeros_like(pose))
            for name, pose in moved.items()}
