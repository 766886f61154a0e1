"""Bodies, joints, contacts and loads: the physics, and its public names for plugins.

    from sparsemor.bodies import LoadPart, NumberOrFunction, find_body
"""

from sparsemor.bodies.body_set import (
    Place,
    Target,
    find_body,
    find_place,
    find_surfaces,
    find_target,
    need_field,
    need_motion,
)
from sparsemor.bodies.fem.pointwise_law import (
    TEMPERATURE,
    TEMPERATURE_RATE,
    PointwiseLaw,
    Response,
    Variable,
    displacement_gradient,
    temperature_gradient,
)
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.floating import (
    FieldInertia,
    inertia_matrices,
    write_frame,
    write_weight,
)
from sparsemor.bodies.frames.frame_items import RigidItem
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.frames.plane_items import PlanePart
from sparsemor.bodies.frames.springs import SpringItem
from sparsemor.bodies.initial_pose import Pose
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.constraint_conditions import (
    Conditions,
    conditions_between,
    conditions_on,
    constant,
)
from sparsemor.bodies.joints.force_element import Drive, ForceElement, Relative
from sparsemor.bodies.joints.joint_sides import Side
from sparsemor.bodies.joints.kinematic_pairs import Between
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction, amplitude, components
from sparsemor.bodies.loads.point_loads import write_point_force
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.terms.dense_term import DenseTerm
from sparsemor.bodies.terms.field_kinds import BODY_KINDS, ELASTIC, MULTIPLIER, RIGID, THERMAL
from sparsemor.bodies.terms.law_functions import curve_at, numbers_of

__all__ = [
    "BODY_KINDS", "Between", "Conditions", "DenseTerm", "Drive", "ELASTIC", "FieldInertia",
    "FloatingBody", "ForceElement", "Isotropic", "JointPart", "LoadPart", "MULTIPLIER",
    "MassProperties", "NumberOrFunction", "Place", "PlanePart", "PointwiseLaw", "Pose", "RIGID",
    "Relative", "Response", "RigidItem", "Side", "SpringItem", "TEMPERATURE",
    "TEMPERATURE_RATE", "THERMAL", "Target", "Variable", "amplitude", "components",
    "conditions_between", "conditions_on", "constant", "curve_at", "displacement_gradient",
    "find_body", "find_place", "find_surfaces", "find_target", "inertia_matrices", "need_field",
    "need_motion", "numbers_of", "temperature_gradient", "write_frame", "write_point_force",
    "write_weight",
]


def __dir__() -> list[str]:
    return __all__
