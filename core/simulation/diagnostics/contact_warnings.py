"""Warnings about a finished run: contacts that never closed, which is most often a mistake in the
scene, chattering contact forces, alternating joint forces, and temperature undershoot."""

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
    """Warnings about contacts that never closed, evaluated along the rigid-body pre-simulation or
    the stored steps; about contact forces that chatter and surfaces that pass each other in too few
    steps, if all steps are available; about alternating joint forces and temperature undershoot."""
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
