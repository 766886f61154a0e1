"""Bodies, joints, contacts and loads: the physics, and its public names for plugins.

    from sparsemor.bodies import LoadPart, NumberOrFunction, find_body
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.bodies.body import FloatingBody as FloatingBody
    from sparsemor.bodies.body_set import Place as Place
    from sparsemor.bodies.body_set import Target as Target
    from sparsemor.bodies.body_set import find_body as find_body
    from sparsemor.bodies.body_set import find_place as find_place
    from sparsemor.bodies.body_set import find_surfaces as find_surfaces
    from sparsemor.bodies.body_set import find_target as find_target
    from sparsemor.bodies.body_set import need_field as need_field
    from sparsemor.bodies.body_set import need_motion as need_motion
    from sparsemor.bodies.fem.pointwise_law import TEMPERATURE as TEMPERATURE
    from sparsemor.bodies.fem.pointwise_law import TEMPERATURE_RATE as TEMPERATURE_RATE
    from sparsemor.bodies.fem.pointwise_law import PointwiseLaw as PointwiseLaw
    from sparsemor.bodies.fem.pointwise_law import Response as Response
    from sparsemor.bodies.fem.pointwise_law import Variable as Variable
    from sparsemor.bodies.fem.pointwise_law import (
        displacement_gradient as displacement_gradient,
    )
    from sparsemor.bodies.fem.pointwise_law import temperature_gradient as temperature_gradient
    from sparsemor.bodies.frames.floating import FieldInertia as FieldInertia
    from sparsemor.bodies.frames.floating import inertia_matrices as inertia_matrices
    from sparsemor.bodies.frames.floating import write_frame as write_frame
    from sparsemor.bodies.frames.floating import write_weight as write_weight
    from sparsemor.bodies.frames.items import RigidItem as RigidItem
    from sparsemor.bodies.frames.moments import MassProperties as MassProperties
    from sparsemor.bodies.frames.plane_items import PlanePart as PlanePart
    from sparsemor.bodies.frames.springs import SpringItem as SpringItem
    from sparsemor.bodies.joints.conditions import Conditions as Conditions
    from sparsemor.bodies.joints.conditions import conditions_between as conditions_between
    from sparsemor.bodies.joints.conditions import conditions_on as conditions_on
    from sparsemor.bodies.joints.conditions import constant as constant
    from sparsemor.bodies.joints.force_element import Drive as Drive
    from sparsemor.bodies.joints.force_element import ForceElement as ForceElement
    from sparsemor.bodies.joints.pairs import Between as Between
    from sparsemor.bodies.joints.part import JointPart as JointPart
    from sparsemor.bodies.joints.relative import Relative as Relative
    from sparsemor.bodies.joints.side import Side as Side
    from sparsemor.bodies.loads.part import LoadPart as LoadPart
    from sparsemor.bodies.loads.part import NumberOrFunction as NumberOrFunction
    from sparsemor.bodies.loads.part import amplitude as amplitude
    from sparsemor.bodies.loads.part import components as components
    from sparsemor.bodies.loads.point_loads import write_point_force as write_point_force
    from sparsemor.bodies.material import Isotropic as Isotropic
    from sparsemor.bodies.pose import Pose as Pose
    from sparsemor.bodies.terms.dense import DenseTerm as DenseTerm
    from sparsemor.bodies.terms.field_kinds import BODY_KINDS as BODY_KINDS
    from sparsemor.bodies.terms.field_kinds import ELASTIC as ELASTIC
    from sparsemor.bodies.terms.field_kinds import MULTIPLIER as MULTIPLIER
    from sparsemor.bodies.terms.field_kinds import RIGID as RIGID
    from sparsemor.bodies.terms.field_kinds import THERMAL as THERMAL
    from sparsemor.bodies.terms.law_functions import curve_at as curve_at
    from sparsemor.bodies.terms.law_functions import numbers_of as numbers_of

_HOMES = {
    "body": ("FloatingBody",),
    "body_set": ("Place", "Target", "find_body", "find_place", "find_surfaces", "find_target",
                 "need_field", "need_motion"),
    "fem.pointwise_law": (
        "PointwiseLaw", "Response", "TEMPERATURE", "TEMPERATURE_RATE",
        "Variable", "displacement_gradient", "temperature_gradient"),
    "frames.floating": ("FieldInertia", "inertia_matrices", "write_frame", "write_weight"),
    "frames.items": ("RigidItem",),
    "frames.moments": ("MassProperties",),
    "frames.plane_items": ("PlanePart",),
    "frames.springs": ("SpringItem",),
    "joints.pairs": ("Between",),
    "joints.conditions": ("Conditions", "conditions_between", "conditions_on", "constant"),
    "joints.force_element": ("Drive", "ForceElement"),
    "joints.part": ("JointPart",),
    "joints.relative": ("Relative",),
    "joints.side": ("Side",),
    "loads.part": ("LoadPart", "NumberOrFunction", "amplitude", "components"),
    "loads.point_loads": ("write_point_force",),
    "material": ("Isotropic",),
    "pose": ("Pose",),
    "terms.dense": ("DenseTerm",),
    "terms.law_functions": ("curve_at", "numbers_of"),
    "terms.field_kinds": ("BODY_KINDS", "ELASTIC", "MULTIPLIER", "RIGID", "THERMAL"),
}
"""Module -> its public names, imported on first access."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.bodies.{module}"), name)
    raise AttributeError(f"module 'sparsemor.bodies' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(n for names in _HOMES.values() for n in names)
