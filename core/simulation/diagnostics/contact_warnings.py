"""Doubts about a finished run, as notes: surfaces that never met, which is most often a mistake of
the scene, contact forces that do not settle, joint forces that alternate, and temperatures that
nothing could cool to."""

import numpy as np

from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import ReportsChatter, ReportsNoContact, ReportsPassage
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.diagnostics.alternating_joint_forces import alternating_forces
from sparsemor.core.simulation.diagnostics.undershoot import undershoot


def contact_warnings(model: Model, result: RunResult) -> tuple[Note, ...]:
    """Notes on contacts that never closed, by the motion of the rigid stage or the stored steps;
    whose forces do not settle, or whose surfaces pass each other in too few steps, by all steps;
    on joints whose forces alternate, and on bodies whose temperature undershoots."""
    texts = [part.missed(_motion(model, result)) for part in model.parts.values()
            if isinstance(part, ReportsNoContact)]
    if model.stage is not None or result.scene["output"]["every"] == 1:
        texts += [part.chatter_warning(history) for name, history in result.contacts().items()
                 if isinstance(part := model.parts[name], ReportsChatter)]
        texts += [part.passage(_motion(model, result)) for part in model.parts.values()
                 if isinstance(part, ReportsPassage)]
    contacts = tuple(Note(text, "contact") for text in texts if text)
    return (*contacts, *alternating_forces(result), *undershoot(model, result))


def _motion(model: Model, result: RunResult) -> dict[str, FrameHistory]:
    if model.stage is not None:
        return dict(model.stage.frames)
    moved = {b.owner: result.block(b.name) for b in result.layout
             if b.kind.quantity is Quantity.POSE}
    return {name: FrameHistory(result.times, pose, np.zeros_like(pose), np.zeros_like(pose))
            for name, pose in moved.items()}
