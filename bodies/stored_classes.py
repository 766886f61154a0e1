"""Classes and functions of which the frames and terms of kept reduced models are made
(`Plugin.stored_classes`)."""

from collections.abc import Sequence

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.bodies.fem.pointwise_law import Variable
from sparsemor.bodies.frames import (
    applied_forces,
    constraints,
    frame,
    frame_items,
    mass_moments,
    mean_displacement_and_rotation,
    springs,
)
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.joints.force_element import Drive, ItemForce
from sparsemor.bodies.joints.joint_heat import FrictionPower, ReducedFrictionHeat
from sparsemor.bodies.loads.built_load import unit
from sparsemor.bodies.loads.cavity_radiation import Exchange, ReducedCavity, nothing
from sparsemor.bodies.loads.joule_heat import Squared
from sparsemor.bodies.loads.surface_heat import Film, GreyBody
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.temperature_file import Samples
from sparsemor.bodies.terms import dense_term, material_laws, nonlinear_strains, polynomial_term
from sparsemor.bodies.terms.point_term import PointTerm
from sparsemor.core.protocols.step_amplitude import Stepping

CLASSES: Sequence[object] = (
    Drive, Exchange, Film, FrictionPower, GreyBody, Inertia, ItemForce, Law, PointTerm,
    ReducedCavity, ReducedFrictionHeat, Samples, Squared, Stepping, TemperatureCurve, Variable,
    nothing, unit,
    applied_forces.BodyForce, applied_forces.Moment, applied_forces.Reaction,
    applied_forces.SpaceForce, constraints.Facing, constraints.Shifted, constraints.Slide,
    constraints.Transmission, constraints.Turned, constraints.UnitLength, dense_term.DenseTerm,
    dense_term.ReducedDense, frame.PlanarFrame, frame.SpatialFrame, frame_items.Compliance,
    frame_items.Nothing, frame_items.Stiffening, frame_items.Wrench, mass_moments.Moments,
    material_laws.Conduction, material_laws.Departure, material_laws.Expansion,
    material_laws.Softening, material_laws.StoredHeat,
    mean_displacement_and_rotation.MeanPoint, mean_displacement_and_rotation.Rotation,
    nonlinear_strains.NonlinearStrains, polynomial_term.PolynomialTerm, springs.Angle,
    springs.Distance, springs.Length, springs.PlaneAngle, springs.RelativeItem,
)
