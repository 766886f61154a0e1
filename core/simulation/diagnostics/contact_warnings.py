"""Warnings about a finished run: contacts that never closed, which is most often a mistake in the
scene, chattering contact forces, and surfaces that pass each other."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import ReportsChatter, ReportsNoContact, ReportsPassage
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.results.run_result import RunResult


def contact_warnings(model: Model, result: RunResult) -> tuple[Note, ...]:
    """Warnings about contacts that never closed, evaluated along the stored steps; about contact
    forces that chatter and surfaces that pass each other in too few steps, if all steps are
    stored."""
    moved = {b.owner: result.block(b.name) for b in result.layout
             if b.kind.quantity is Quantity.POSE}
    motion = {name: FrameHistory(result.times, pose, np.zeros_like(pose), np.zeros_like(pose))
              for name, pose in moved.items()}
    every = result.scene["output"]["every"] == 1
    return _warnings(model, motion, result.contacts() if every else None)


def stage_warnings(model: Model) -> tuple[Note, ...] | None:
    """The same along a rigid-body pre-simulation; None without one."""
    stage = model.stage
    return None if stage is None else _warnings(model, stage.frames, {
        name: {"time": stage.times, **kept} for name, kept in stage.contacts.items()})


def _warnings(
    model: Model, motion: Mapping[str, FrameHistory],
    contacts: Mapping[str, Mapping[str, FloatArray]] | None,
) -> tuple[Note, ...]:
    parts = model.parts.values()
    texts = [part.missed(motion) for part in parts if isinstance(part, ReportsNoContact)]
    if contacts is not None:
        texts += [part.chatter_warning(history) for name, history in contacts.items()
                  if isinstance(part := model.parts[name], ReportsChatter)]
        texts += [part.passage(motion) for part in parts if isinstance(part, ReportsPassage)]
    return tuple(Note(text, "contact") for text in texts if text)
