"""Warnings about a finished run: contacts that never closed, which is most often a mistake in the
scene, chattering contact forces, and surfaces that pass each other."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import (
    Check,
    Findings,
    FloatArray,
    FrameHistory,
    Model,
    Note,
    PreparedRun,
    Quantity,
    RunResult,
)
from sparsemor.plugins.checks import place


class Contacts(Check):
    """Contacts that never close, chatter, or let surfaces pass each other. Those of a rigid-body
    pre-simulation (`Model.stage`) are looked at before the steps."""

    order = place("contacts")

    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        return Findings(() if run.model is None else stage_warnings(run.model))

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        if run.model is None or run.model.stage is not None:
            return Findings()
        return Findings(contact_warnings(run.model, result))


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


def stage_warnings(model: Model) -> tuple[Note, ...]:
    """The same along a rigid-body pre-simulation."""
    stage = model.stage
    return () if stage is None else _warnings(model, stage.frames, {
        name: {"time": stage.times, **kept} for name, kept in stage.contacts.items()})


def _warnings(
    model: Model, motion: Mapping[str, FrameHistory],
    contacts: Mapping[str, Mapping[str, FloatArray]] | None,
) -> tuple[Note, ...]:
    """Warnings about contacts along a motion of all bodies; contacts: histories of their resultants
    (`RunResult.contacts`), None where not every step is stored. A contact without a finding has
    an empty text."""
    parts = model.contacts
    texts = [part.missed(motion) for part in parts.values()]
    if contacts is not None:
        texts += [parts[name].chatter_warning(history) for name, history in contacts.items()
                  if name in parts]
        texts += [part.passage(motion) for part in parts.values()]
    return tuple(Note(text, "contact") for text in texts if text)
