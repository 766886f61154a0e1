"""Constant finite-element matrices of a body's elastic and thermal fields."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from sparsemor.bodies.fem.elasticity import Law, general
from sparsemor.bodies.fem.pointwise_law import PointwiseLaw, StressLaw
from sparsemor.core import Csr, FloatArray, IntArray, Mesh, StressConstants, TimeFunction


@dataclass(frozen=True, slots=True, eq=False)
class ModalFactors:
    """Damping matrix L diag(c) L^T of all displacements: L (d N, p) = M Phi, kg^(1/2); c (p,) =
    2 zeta omega, 1/s."""

    L: FloatArray
    c: FloatArray


Cells: TypeAlias = IntArray | None
"""Numbers of cells, None for all cells of a body."""


@dataclass(frozen=True, slots=True, eq=False)
class Elasticity:
    """Constant matrices of an elastic body over all d N displacements; `free` (n,): numbers of the
    unknown ones.

    coupling (d N, N): thermal forces K_fT; damping: Rayleigh, a mass + b stiffness; modal: modal
    damping. regions: cells of each material, with the constants of their element matrices. laws:
    stress beyond that of constant properties and linear strains, and its cells: of properties that
    depend on temperature and of nonlinear strains. nonlinear: True for Green-Lagrange strains;
    prestressed: True if the geometric stiffness of its loads is part of the equations. recoverable:
    True if stress follows from strain and temperature with constant properties. two_way: True if
    strain rates heat the body.
    """

    free: IntArray
    stiffness: Csr
    damping: Csr
    coupling: Csr
    modal: ModalFactors | None = None
    regions: tuple[tuple[Cells, Law], ...] = ()
    laws: tuple[tuple[StressLaw, Cells], ...] = ()
    nonlinear: bool = False
    prestressed: bool = False
    recoverable: bool = True
    two_way: bool = False

    def stress_constants(self, mesh: Mesh, free: FloatArray) -> StressConstants:
        """Constants of the stress in all cells, one row for each material and the number of the row
        for each cell; free (N,): stress-free temperature, K. A row has lam, mu, beta, and lam, beta
        of the stress across the plane, or, where some material depends on the direction, the 46
        numbers of `general`; and a 1 at the end for a body of revolution."""
        cells = len(mesh.cells)
        region = np.zeros(cells, np.int64)
        for number, (here, _) in enumerate(self.regions):
            region[slice(None) if here is None else here] = number
        laws = [m for _, m in self.regions]
        constants = np.array([[m.lam, m.mu, m.beta, m.lam_out, m.beta_out] for m in laws])
        if any(m.anisotropy is not None for m in laws):
            constants = np.array([general(m) for m in laws])
        if mesh.revolved:
            constants = np.pad(constants, ((0, 0), (0, 1)), constant_values=1.0)
        return StressConstants(constants, region, free, self.nonlinear)


@dataclass(frozen=True, slots=True, eq=False)
class Heat:
    """Capacity and conductivity matrices over all N temperatures; `free` (m,): numbers of the
    unknown ones.

    prescribed: temperatures that are no unknowns, sums of shape * f(t), K: nodes, f, shape (n,).
    regions: cells of each material, with rho c thickness, J/(m2 K), and k thickness, W/K (in space
    rho c and k), of their element matrices. lumped: True for a diagonal capacity matrix (row sums).
    laws: heat flux and stored heat beyond those of constant properties, where they depend on
    temperature, and their cells.
    """

    free: IntArray
    capacity: Csr
    conductivity: Csr
    prescribed: tuple[tuple[IntArray, TimeFunction, FloatArray], ...] = ()
    regions: tuple[tuple[Cells, tuple[float, float | FloatArray]], ...] = ()
    lumped: bool = False
    laws: tuple[tuple[PointwiseLaw, Cells], ...] = ()


def numbered(free: IntArray, size: int) -> IntArray:
    """(size,) position of each unknown among the free ones; -1 for prescribed ones."""
    positions = np.full(size, -1, dtype=np.int64)
    positions[free] = np.arange(len(free))
    return positions


class HasFields(Protocol):
    """Interface of a body with a mesh and fields: elasticity, heat: matrices of the fields, None
    without one; T0, T_ref (N,): initial and stress-free temperature, K, None for a body without
    fields; thickness, m, 1 in space."""

    @property
    def name(self) -> str: ...
    @property
    def mesh(self) -> Mesh | None: ...
    @property
    def thickness(self) -> float: ...
    @property
    def elasticity(self) -> Elasticity | None: ...
    @property
    def heat(self) -> Heat | None: ...
    @property
    def T0(self) -> FloatArray | None: ...
    @property
    def T_ref(self) -> FloatArray | None: ...
