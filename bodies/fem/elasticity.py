"""Isotropic thermoelasticity: plane stress, plane strain, 3-D.

sigma = lam tr(eps) I + 2 mu eps - beta dT I, with constants that depend on the model.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from sparsemor.bodies.material import Constants, require
from sparsemor.core import Csr, FloatArray, InputError, IntArray, Mesh

Model: TypeAlias = Literal["plane_stress", "plane_strain", "solid"]


@dataclass(frozen=True, slots=True)
class Law:
    """Constants of the thermoelastic law: lam, mu in Pa, beta in Pa/K, for the components in d
    dimensions.

    The stress normal to the plane is lam_out tr(eps) - beta_out dT; both constants are 0 in plane
    stress.
    """

    lam: float
    mu: float
    beta: float
    lam_out: float
    beta_out: float


def expansion_factor(nu: float, model: Model) -> float:
    """Ratio beta / (E alpha) of the thermal stress in the directions of the law: 1 / (1 - nu) in
    plane stress, 1 / (1 - 2 nu) otherwise."""
    return 1.0 / (1.0 - nu) if model == "plane_stress" else 1.0 / (1.0 - 2.0 * nu)


def law(material: Constants, model: Model) -> Law:
    """Constants of the thermoelastic law of a material; InputError when E or nu is missing."""
    E, nu, alpha = require(material, ("E", "nu", "alpha"), "elastic")
    mu = E / (2 * (1 + nu))
    if model == "plane_stress":
        return Law(E * nu / (1 - nu**2), mu, E * alpha / (1 - nu), 0.0, 0.0)
    # held across the plane, an element pushes outwards as if alpha were (1 + nu) alpha in the
    # plane's own law; written with the solid's constants the factor is the same beta
    lam, beta = E * nu / ((1 + nu) * (1 - 2 * nu)), E * alpha / (1 - 2 * nu)
    return Law(lam, mu, beta, lam, beta)


def elastic_stiffness(
    mesh: Mesh, material: Constants, thickness: float = 1.0, model: Model = "plane_stress",
    cells: IntArray | None = None,
) -> Csr:
    """Stiffness matrix (d N, d N), N/m; unknown number is d * node + component. thickness in m, 1
    in 3-D. cells: numbers of the cells to integrate over, None for all.

    Singular: contains the rigid-body modes.
    """
    from sparsemor.bodies.fem import forms

    _check_model(mesh, model)
    s = law(material, model)
    return forms.matrix(forms.stiffness, mesh, 0, rows=True, columns=True, cells=cells,
                        lam=thickness * s.lam, mu=thickness * s.mu)


def thermoelastic_coupling(
    mesh: Mesh, material: Constants, thickness: float = 1.0, model: Model = "plane_stress",
    cells: IntArray | None = None,
) -> Csr:
    """Coupling matrix K_fT (d N, N), N/K: nodal thermal forces are K_fT (T - T_ref), T of the
    elements' order in each cell."""
    from sparsemor.bodies.fem import forms

    _check_model(mesh, model)
    weight = thickness * law(material, model).beta
    return forms.matrix(forms.expansion, mesh, 1, rows=True, cells=cells, weight=weight)


def _check_model(mesh: Mesh, model: Model) -> None:
    allowed = ("solid",) if mesh.dimension == 3 else ("plane_stress", "plane_strain")
    if model not in allowed:
        raise InputError(
            f"{model} does not suit a {mesh.dimension}-D mesh: take {' or '.join(allowed)}", "model"
        )


def rigid_modes(X: FloatArray) -> FloatArray:
    """(d N, 3 or 6) rigid-body modes of points X (N, d), of unit order."""
    d = X.shape[1]
    arm = (X - X.mean(axis=0)) / max(float(np.ptp(X, axis=0).max()), 1e-300)
    turns = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((len(X), d, d + len(turns)))
    modes[:, range(d), range(d)] = 1.0
    for k, (i, j) in enumerate(turns):
        modes[:, i, d + k], modes[:, j, d + k] = -arm[:, j], arm[:, i]
    return modes.reshape(-1, modes.shape[2])
