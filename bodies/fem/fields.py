"""Constant finite-element matrices of a body's elastic and thermal fields."""

from dataclasses import dataclass

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.core import Csr, IntArray, TimeFunction


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
