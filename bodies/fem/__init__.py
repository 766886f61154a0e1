"""Finite-element matrices of cells of all kinds; common functions for 2-D and 3-D."""

from sparsemor.bodies.fem.elasticity import (
    Law,
    Model,
    elastic_stiffness,
    law,
    thermoelastic_coupling,
)
from sparsemor.bodies.fem.surface import (
    boundary_facets,
    facet_measures,
    facet_normals,
    surface_load,
    surface_mass,
    surface_normal_load,
)
from sparsemor.bodies.fem.volume import capacity, conductivity, scalar_mass

__all__ = [
    "Law", "Model", "boundary_facets", "capacity", "conductivity", "elastic_stiffness",
    "facet_measures", "facet_normals", "law", "scalar_mass", "surface_load", "surface_mass",
    "surface_normal_load", "thermoelastic_coupling",
]
