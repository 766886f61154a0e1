"""Finite-element matrices of linear simplices, the same functions in 2-D and 3-D."""

from sparsemor.bodies.fe.elasticity import (
    Law,
    Model,
    elastic_stiffness,
    law,
    stress,
    thermoelastic_coupling,
)
from sparsemor.bodies.fe.surface import (
    boundary_facets,
    facet_measures,
    facet_normals,
    facet_points,
    surface_load,
    surface_mass,
    surface_normal_load,
)
from sparsemor.bodies.fe.volume import capacity, conductivity, scalar_mass

__all__ = [
    "Law", "Model", "boundary_facets", "capacity", "conductivity", "elastic_stiffness",
    "facet_measures", "facet_normals", "facet_points", "law", "scalar_mass", "stress",
    "surface_load", "surface_mass", "surface_normal_load", "thermoelastic_coupling",
]
