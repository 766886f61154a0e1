"""Stress of a mesh at the centroids of its cells, by the law that results recover it with."""

import numpy as np

from sparsemor.bodies.fem.elasticity import Model, law
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.core import Material, Mesh
from sparsemor.core.arrays import FloatArray


def cell_stress(
    mesh: Mesh, material: Material, model: Model, u: FloatArray, dT: FloatArray
) -> FloatArray:
    """(E, 3, 3) Cauchy stress, Pa, for displacements u (d N,) and temperatures above the
    stress-free one dT (N,): the mean over the nodes of a cell, which for linear fields is the value
    at its centroid."""
    s = law(material, model)
    made = CellStress(
        mesh.points, mesh.nodes, np.array([[s.lam, s.mu, s.beta, s.lam_out, s.beta_out]]),
        np.zeros(len(mesh.nodes), np.int64))
    return np.asarray(made.stress_in_cells(u.reshape(len(mesh.points), -1), dT).mean(axis=1))
