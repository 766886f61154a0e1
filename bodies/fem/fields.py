"""Constant finite-element matrices of a body's elastic and thermal fields."""

from dataclasses import dataclass
from typing import Protocol

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.core import Csr, FloatArray, IntArray, Mesh, TimeFunction


@dataclass(frozen=True, slots=True, eq=False)
class Elasticity:
    """Constant matrices over all 2N displacements; `free` (n,) are the unknown ones.

    coupling (2N, N) K_fT; damping is Rayleigh's: a mass + b stiffness. law: what the element
    matrices are made from once more, for reducers that weigh elements.
    """

    free: IntArray
    stiffness: Csr
    damping: Csr
    coupling: Csr
    law: Law | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Heat:
    """Capacity and conductivity over all N temperatures; `free` (m,) are the unknown ones.

    prescribed: (nodes, function) pairs of temperatures that the scene gives. constants: rho c
    thickness, J/(m2 K), and k thickness, W/K, for element matrices. lumped: whether the capacity is
    diagonal, its row sums.
    """

    free: IntArray
    capacity: Csr
    conductivity: Csr
    prescribed: tuple[tuple[IntArray, TimeFunction], ...] = ()
    constants: tuple[float, float] | None = None
    lumped: bool = False


class HasFields(Protocol):
    """A body's mesh and fields, as `bodies.body.Body` has them: T0, T_ref (N,) K, thickness m."""

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
