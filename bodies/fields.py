"""Constant finite-element matrices of a body's elastic and thermal fields."""

from dataclasses import dataclass

from sparsemor.core.arrays import Csr, IntArray
from sparsemor.core.protocols import TimeFunction


@dataclass(frozen=True, slots=True, eq=False)
class Elasticity:
    """Constant matrices over all 2N displacements; `free` (n,) are the unknown ones.

    coupling (2N, N) K_fT; damping is Rayleigh's: a mass + b stiffness.
    """

    free: IntArray
    stiffness: Csr
    damping: Csr
    coupling: Csr


@dataclass(frozen=True, slots=True, eq=False)
class Heat:
    """Capacity and conductivity over all N temperatures; `free` (m,) are the unknown ones.

    prescribed: (nodes, function) pairs of temperatures that the scene gives.
    """

    free: IntArray
    capacity: Csr
    conductivity: Csr
    prescribed: tuple[tuple[IntArray, TimeFunction], ...] = ()
