"""Bodies, joints, contacts and loads: the physics, and its public names for plugins.

    from sparsemor.bodies import LoadPart, Quantity, find_body
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.bodies.joints.conditions import Rows as Rows
    from sparsemor.bodies.joints.conditions import rows_between as rows_between
    from sparsemor.bodies.joints.conditions import rows_on as rows_on
    from sparsemor.bodies.joints.plane_attachment import constant as constant
    from sparsemor.bodies.joints.plane_attachment import plane as plane
    from sparsemor.bodies.joints.plane_part import End as End
    from sparsemor.bodies.joints.plane_part import JointPart as JointPart
    from sparsemor.bodies.joints.space_part import SpaceJoint as SpaceJoint
    from sparsemor.bodies.loads.amplitude import Quantity as Quantity
    from sparsemor.bodies.loads.amplitude import amplitude as amplitude
    from sparsemor.bodies.loads.part import LoadPart as LoadPart
    from sparsemor.bodies.material import Material as Material
    from sparsemor.bodies.planar_body import PlanarBody as PlanarBody
    from sparsemor.bodies.pose import Pose as Pose
    from sparsemor.bodies.spatial_body import SpatialBody as SpatialBody
    from sparsemor.bodies.targets import Target as Target
    from sparsemor.bodies.targets import find_body as find_body
    from sparsemor.bodies.targets import find_surfaces as find_surfaces
    from sparsemor.bodies.targets import find_target as find_target
    from sparsemor.bodies.targets import need_field as need_field
    from sparsemor.bodies.terms.dense import DenseTerm as DenseTerm
    from sparsemor.bodies.terms.field_kinds import BODY_KINDS as BODY_KINDS
    from sparsemor.bodies.terms.field_kinds import ELASTIC as ELASTIC
    from sparsemor.bodies.terms.field_kinds import MULTIPLIER as MULTIPLIER
    from sparsemor.bodies.terms.field_kinds import RIGID as RIGID
    from sparsemor.bodies.terms.field_kinds import THERMAL as THERMAL

_HOMES = {
    "joints.conditions": ("Rows", "rows_between", "rows_on"),
    "joints.plane_attachment": ("constant", "plane"),
    "joints.plane_part": ("End", "JointPart"),
    "joints.space_part": ("SpaceJoint",),
    "loads.amplitude": ("Quantity", "amplitude"),
    "loads.part": ("LoadPart",),
    "material": ("Material",),
    "planar_body": ("PlanarBody",),
    "pose": ("Pose",),
    "spatial_body": ("SpatialBody",),
    "targets": ("Target", "find_body", "find_surfaces", "find_target", "need_field"),
    "terms.dense": ("DenseTerm",),
    "terms.field_kinds": ("BODY_KINDS", "ELASTIC", "MULTIPLIER", "RIGID", "THERMAL"),
}
"""Module -> its public names, imported when they are asked for."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.bodies.{module}"), name)
    raise AttributeError(f"module 'sparsemor.bodies' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(n for names in _HOMES.values() for n in names)
