"""Classes and functions of which the frames and terms of kept reduced models are made
(`StoresObjects`)."""

from collections.abc import Sequence
from typing import Any

from sparsemor.bodies.frames import force_items, frame, items, joint_items, moments
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.plane import PlanarFrame
from sparsemor.bodies.loads.amplitude import unit

CLASSES: Sequence[Any] = (
    Inertia, PlanarFrame, unit, force_items.BodyForce, force_items.SpaceForce, frame.SpatialFrame,
    items.Nothing, joint_items.Attachment, joint_items.Reaction, joint_items.Rotation,
    moments.Moments,
)
