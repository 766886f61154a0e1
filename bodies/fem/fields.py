"""Constant finite-element matrices of a body's elastic and thermal fields."""

from dataclasses import dataclass
from typing import Protocol

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.core import Csr, FloatArray, IntArray, Mesh, TimeFunction


@dataclass(frozen=True, slots=True, eq=False)
class Elasticity:
    """Constant matrices of an elastic body over all d N displacements; `free` (n,): numbers of the
    unknown ones.

    coupling (d N, N): thermal forces K_fT; damping: Rayleigh, a mass + b stiffness. law: constants
    of the element matrices, for reducers that weight elements.
    """

    free: IntArray
    stiffness: Csr
    damping: Csr
    coupling: Csr
    law: Law | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Heat:
    """Capacity and conductivity matrices over all N temperatures; `free` (m,): numbers of the
    unknown ones.

    prescribed: pairs (nodes, function) of prescribed temperatures. constants: rho c thickness,
    J/(m2 K), and k thickness, W/K, for element matrices. lumped: True for a diagonal capacity
    matrix (row sums).
    """

    free: IntArray
    capacity: Csr
    conductivity: Csr
    prescribed: tuple[tuple[IntArray, TimeFunction], ...] = ()
    constants: tuple[float, float] | None = None
    lumped: bool = False


class HasFields(Protocol):
    """Interface of a body with a mesh and fields: T0, T_ref (N,): initial and stress-free
    temperature, K; thickness, m."""

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
