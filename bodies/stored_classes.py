"""Classes and functions of which the frames and terms of kept reduced models are made
(`Plugin.stored_classes`)."""

from collections.abc import Sequence

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.bodies.fem.pointwise_law import Variable
from sparsemor.bodies.frames import (
    constraints,
    force_items,
    frame,
    items,
    joint_items,
    moments,
    springs,
)
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.joints.force_element import Drive, ItemForce
from sparsemor.bodies.joints.heat import FrictionPower, ReducedFrictionHeat
from sparsemor.bodies.loads.cavity_radiation import Exchange, ReducedCavity, nothing
from sparsemor.bodies.loads.joule_heat import Squared
from sparsemor.bodies.loads.part import unit
from sparsemor.bodies.loads.surface_heat import Film, GreyBody
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.temperature_file import Samples
from sparsemor.bodies.terms import dense, material_laws, nonlinear_strains, polynomial
from sparsemor.bodies.terms.point_term import PointTerm

CLASSES: Sequence[object] = (
    Drive, Exchange, Film, FrictionPower, GreyBody, Inertia, ItemForce, Law, PointTerm,
    ReducedCavity, ReducedFrictionHeat, Samples, Squared, TemperatureCurve, Variable, nothing, unit,
    constraints.Facing, constraints.Shifted, constraints.Slide, constraints.Transmission,
    constraints.Turned, dense.DenseTerm, dense.ReducedDense,
    force_items.BodyForce, force_items.Moment, force_items.SpaceForce, frame.PlanarFrame,
    frame.SpatialFrame, items.Compliance, items.Nothing, items.Stiffening, items.UnitLength,
    items.Wrench, joint_items.MeanPoint, joint_items.Reaction, joint_items.Rotation,
    material_laws.Conduction, material_laws.Departure, material_laws.Expansion,
    material_laws.Softening, material_laws.StoredHeat, moments.Moments,
    nonlinear_strains.NonlinearStrains, polynomial.PolynomialTerm, springs.Angle, springs.Distance,
    springs.Length, springs.PlaneAngle, springs.RelativeItem,
)
