"""Thermoelasticity: plane stress, plane strain, 3-D.

sigma = lam tr(eps) I + 2 mu eps - beta dT I, with constants that depend on the model; of a material
with properties that depend on the direction sigma = C eps - beta dT (`Anisotropy`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from sparsemor.bodies.material import Constants, require
from sparsemor.core import Csr, FloatArray, InputError, IntArray, Mesh
from sparsemor.core.protocols.body import DirectionalProperties

Weight: TypeAlias = float | FloatArray
Form: TypeAlias = Callable[..., FloatArray]
Model: TypeAlias = Literal["plane_stress", "plane_strain", "solid"]


@dataclass(frozen=True, slots=True)
class Law:
    """Constants of the thermoelastic law sigma = lam tr(eps) I + 2 mu eps - beta dT I: lam, mu in
    Pa, beta in Pa/K, for the components in d dimensions; with `anisotropy` they are nan.

    The stress normal to the plane is lam_out tr(eps) - beta_out dT; both constants are 0 in plane
    stress.
    """

    lam: float
    mu: float
    beta: float
    lam_out: float
    beta_out: float
    anisotropy: "Anisotropy | None" = None


@dataclass(frozen=True, slots=True, eq=False)
class Anisotropy:
    """Constants of a law in d dimensions that depends on the direction, components as in
    `DirectionalProperties`, in the plane xx, yy, xy.

    C (s, s): stiffness, Pa; beta (d, d): thermal stress, Pa/K. recovery (46,): stiffness (6, 6) and
    thermal stress (6,) in space, and strain across the plane, of plane stress, by the strains xx,
    yy, xy and by dT.
    """

    C: FloatArray
    beta: FloatArray
    recovery: FloatArray

    @classmethod
    def from_material(cls, material: DirectionalProperties, model: Model) -> "Anisotropy":
        """Stiffness and thermal stress in the plane or in space, with the constants of the stress
        across the plane (6, 6), (6,), and of the strain across it (4,), for plane stress only: the
        46 numbers of `recovery`. Components xx, yy, zz, yz, zx, xy; plane: those in the plane."""
        assert material.stiffness is not None
        C, alpha, plane = material.stiffness, material.expansion, [0, 1, 5]
        beta, across = C @ alpha, np.zeros(4)
        if model == "solid":
            return cls(C, _tensor(beta), np.concatenate([C.ravel(), beta, across]))
        if model == "plane_strain":  # the stress across follows from C in space
            return cls(C[np.ix_(plane, plane)], _tensor(beta)[:2, :2],
                       np.concatenate([C.ravel(), beta, across]))
        # plane stress: the compliance S of the plane's components is inverted on its own
        S = np.linalg.inv(C)
        in_plane = np.linalg.inv(S[np.ix_(plane, plane)])
        thermal_in_plane = in_plane @ alpha[plane]
        across = np.append(S[2, plane] @ in_plane, alpha[2] - S[2, plane] @ thermal_in_plane)
        in_space, thermal = np.zeros((6, 6)), np.zeros(6)
        in_space[np.ix_(plane, plane)], thermal[plane] = in_plane, thermal_in_plane
        return cls(in_plane, _tensor(thermal)[:2, :2],
                   np.concatenate([in_space.ravel(), thermal, across]))


def general(law: Law) -> FloatArray:
    """Numbers (46,) of a law as `Anisotropy.recovery`, of an isotropic one too: stiffness (6, 6)
    and thermal stress (6,) with components xx, yy, zz, yz, zx, xy, and strain across the plane by
    the strains xx, yy, xy and dT (4,), which plane stress alone has: of it lam_out, beta_out are
    0."""
    if law.anisotropy is not None:
        return law.anisotropy.recovery
    C, beta, across = np.zeros((6, 6)), np.zeros(6), np.zeros(4)
    C[:2, :2], C[2, :2] = law.lam, law.lam_out
    C[range(2), range(2)] += 2.0 * law.mu
    C[range(3, 6), range(3, 6)], beta[:3] = law.mu, (law.beta, law.beta, law.beta_out)
    if law.lam_out or law.beta_out:
        C[:2, 2], C[2, 2] = law.lam, law.lam_out + 2.0 * law.mu
    else:
        across[:2], across[3] = -law.lam / (2.0 * law.mu), law.beta / (2.0 * law.mu)
    return np.concatenate([C.ravel(), beta, across])


def _tensor(v: FloatArray) -> FloatArray:
    """(3, 3) tensor of a stress (6,)."""
    return np.array([[v[0], v[5], v[4]], [v[5], v[1], v[3]], [v[4], v[3], v[2]]])


def expansion_factor(nu: float, model: Model) -> float:
    """Ratio beta / (E alpha) of the thermal stress in the directions of the law: 1 / (1 - nu) in
    plane stress, 1 / (1 - 2 nu) otherwise."""
    return 1.0 / (1.0 - nu) if model == "plane_stress" else 1.0 / (1.0 - 2.0 * nu)


def law(material: Constants, model: Model) -> Law:
    """Constants of the thermoelastic law of a material: lam, mu, beta, and lam, beta of the stress
    across the plane. InputError when a property is missing."""
    if (directional := material.directional()) is not None:
        require(material, ("E", "nu"), "elastic")
        none = float("nan")  # no such constants
        return Law(none, none, none, none, none, Anisotropy.from_material(directional, model))
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
    from sparsemor.bodies.fem import element_matrices

    _check_model(mesh, model)
    form, weights = stiffness_form(law(material, model), thickness)
    return element_matrices.matrix(form, mesh, 0, rows=True, columns=True, cells=cells, **weights)


def thermoelastic_coupling(
    mesh: Mesh, material: Constants, thickness: float = 1.0, model: Model = "plane_stress",
    cells: IntArray | None = None,
) -> Csr:
    """Coupling matrix K_fT (d N, N), N/K: nodal thermal forces are K_fT (T - T_ref), T of the
    elements' order in each cell."""
    from sparsemor.bodies.fem import element_matrices

    _check_model(mesh, model)
    return element_matrices.matrix(element_matrices.expansion, mesh, 1, rows=True, cells=cells,
                        weight=expansion_weight(law(material, model), thickness))


def stiffness_form(law: Law, thickness: float) -> tuple[Form, dict[str, Weight]]:
    """Form of the stiffness by a law, and its weights."""
    from sparsemor.bodies.fem import element_matrices

    if law.anisotropy is not None:
        return element_matrices.anisotropic, {"C": thickness * law.anisotropy.C}
    return element_matrices.stiffness, {"lam": thickness * law.lam, "mu": thickness * law.mu}


def expansion_weight(law: Law, thickness: float) -> Weight:
    """Weight of the thermal forces: a number, or a tensor (d, d)."""
    return thickness * (law.beta if law.anisotropy is None else law.anisotropy.beta)


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
