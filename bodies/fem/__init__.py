"""Finite-element matrices of cells of all kinds; common functions for 2-D and 3-D."""

from sparsemor.bodies.fem.elasticity import (
    Law,
    Model,
    elastic_stiffness,
    law,
    thermoelastic_coupling,
)
from sparsemor.bodies.fem.integrals import (
    boundary_facets,
    capacity,
    conductivity,
    facet_measures,
    scalar_mass,
    surface_load,
    surface_mass,
    surface_normal_load,
)

__all__ = [
    "Law", "Model", "boundary_facets", "capacity", "conductivity", "elastic_stiffness",
    "facet_measures", "law", "scalar_mass", "surface_load", "surface_mass",
    "surface_normal_load", "thermoelastic_coupling",
]
