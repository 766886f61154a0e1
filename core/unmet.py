"""Contacts whose surfaces never met in a run: most often a mistake of the scene, told as a note."""

import numpy as np

from sparsemor.core.model import Model
from sparsemor.core.results import RunResult
from sparsemor.core.stage import FrameHistory


def unmet(model: Model, result: RunResult) -> tuple[str, ...]:
    """A sentence for each part with a method `missed(motion)` that has something to say of how the
    bodies moved: along the rigid stage where there was one, else in the stored steps."""
    asked = [missed for part in model.parts.values()
             if (missed := getattr(part, "missed", None)) is not None]
    if not asked:
        return ()
    told = (str(missed(_motion(model, result))) for missed in asked)
    return tuple(text for text in told if text)


def _motion(model: Model, result: RunResult) -> dict[str, FrameHistory]:
    if model.stage is not None:
        return dict(model.stage.frames)
    moved = {b.owner: result.block(b.name) for b in result.layout if b.field == "rigid"}
    return {name: FrameHistory(result.times, pose, np.zeros_like(pose), np.zeros_like(pose))
            for name, pose in moved.items()}
