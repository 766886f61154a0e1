"""Orthotropic material: other properties along each of three perpendicular axes, such as those of
wood, rolled sheets and layers of fibres."""

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, InputError, Material, MaterialProperties
from sparsemor.core.protocols.body import DirectionalProperties

Positive = Annotated[float, Field(gt=0)]
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""Components of a symmetric tensor, in the order of its six numbers."""


class Orthotropic(Material):
    """Orthotropic linear thermoelastic material, with constant properties along its axes 1, 2, 3.

    These are the body axes x, y, z, turned by `angle` about `axis`; of a plane body 3 is normal to
    the plane. nu_ij is the contraction along j under tension along i: nu_ij / E_i = nu_ji / E_j.
    """

    rho: float = Field(gt=0)
    """Density in the reference shape, kg/m3."""
    E: tuple[Positive, Positive, Positive] | None = None
    """Young's moduli along 1, 2 and 3, Pa."""
    nu: tuple[float, float, float] | None = None
    """Poisson's ratios nu_12, nu_13 and nu_23."""
    G: tuple[Positive, Positive, Positive] | None = None
    """Shear moduli of the planes 12, 13 and 23, Pa."""
    alpha: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Coefficients of linear thermal expansion along 1, 2 and 3, 1/K."""
    k: tuple[Positive, Positive, Positive] | None = None
    """Thermal conductivities along 1, 2 and 3, W/(m K)."""
    c: float | None = Field(default=None, gt=0)
    """Specific heat, J/(kg K)."""
    angle: float = 0.0
    """Rotation of the axes 1, 2, 3 from the body axes, rad."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Axis of this rotation, of any length; of a plane body z."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        """Checks that the elastic constants are given together and that the energy of each strain
        is positive."""
        given = [n for n in ("E", "nu", "G") if getattr(self, n) is not None]
        if given and len(given) < 3:
            raise ValueError(f"the elastic field needs E, nu and G together (got {given[0]} "
                             "without the others)")
        if not np.any(self.axis):
            raise InputError("the axis has the length zero", "axis")
        if given and not (np.linalg.eigvalsh(self._compliance) > 0.0).all():
            raise InputError("the elastic energy of some strain would be negative: take smaller "
                             "Poisson's ratios (|nu_ij| < sqrt(E_i / E_j), and together)", "nu")
        return self

    def properties(self) -> MaterialProperties:
        return MaterialProperties(self.rho, c=self.c)

    def directional(self) -> DirectionalProperties:
        """Stiffness (6, 6), Pa, expansion (6,), 1/K, and conductivity (3, 3), W/(m K), in body
        axes, rotated from those of the material. Components in the order of `PAIRS`, shear strains
        twice the tensor's; A: axes of the material as columns."""
        A = self._axes
        T = np.zeros((6, 6))  # strains in material axes from those in body axes
        for m, (i, j) in enumerate(PAIRS):
            for n, (p, q) in enumerate(PAIRS):
                T[m, n] = (A[p, i] * A[q, j] + A[q, i] * A[p, j] * (p != q)) * (
                    1.0 if i == j else 2.0) * (1.0 if p == q else 0.5)
        stiffness = None if self.E is None else T.T @ np.linalg.inv(self._compliance) @ T
        expansion = A @ np.diag(self.alpha) @ A.T
        return DirectionalProperties(
            stiffness, np.array([expansion[i, j] * (1.0 if i == j else 2.0) for i, j in PAIRS]),
            None if self.k is None else A @ np.diag(self.k) @ A.T)

    @cached_property
    def _compliance(self) -> FloatArray:
        """(6, 6) compliance along its own axes, 1/Pa."""
        assert self.E is not None and self.nu is not None and self.G is not None
        (E1, E2, E3), (n12, n13, n23), (G12, G13, G23) = self.E, self.nu, self.G
        S = np.diag([1.0 / E1, 1.0 / E2, 1.0 / E3, 1.0 / G23, 1.0 / G13, 1.0 / G12])
        S[0, 1] = S[1, 0] = -n12 / E1
        S[0, 2] = S[2, 0] = -n13 / E1
        S[1, 2] = S[2, 1] = -n23 / E2
        return S

    @property
    def _axes(self) -> FloatArray:
        """(3, 3) axes 1, 2, 3 as columns, in body axes."""
        e = np.asarray(self.axis) / np.linalg.norm(self.axis)
        cross = np.array([[0.0, -e[2], e[1]], [e[2], 0.0, -e[0]], [-e[1], e[0], 0.0]])
        return np.asarray(np.eye(3) + np.sin(self.angle) * cross
                          + (1.0 - np.cos(self.angle)) * cross @ cross)
