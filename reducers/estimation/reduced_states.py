"""Reduced states of one block in the coordinates of its error equation.

A complete basis spans all unknowns of its block, and a space of errors that contained all of it
would be as large as the mesh. There the space contains the leading atoms alone, x_reduced is
projected on it, and what the projection leaves is counted as an error: with the solution x_E of the
error space's equations, |x_E - x_reduced|^2 = |x_E - P x_reduced|^2 + |x_reduced - P x_reduced|^2.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.reducers.estimation.error_space import ErrorSpace


class StateMap(Protocol):
    """Map of coefficients (j, k) of j states or rates to the coordinates (j, q) of the error
    equation, and to their part outside (j, n), n = 0 where the error space contains all atoms."""

    @property
    def outside(self) -> int: ...
    def __call__(self, C: FloatArray) -> tuple[FloatArray, FloatArray]: ...


@dataclass(frozen=True, slots=True, eq=False)
class InAtoms:
    """The coefficients themselves."""

    @property
    def outside(self) -> int:
        return 0

    def __call__(self, C: FloatArray) -> tuple[FloatArray, FloatArray]:
        return C, np.zeros((len(C), 0))


@dataclass(frozen=True, slots=True, eq=False)
class InModes:
    """Coordinates in modes that span the atoms: atoms = modes @ lift, lift (q, k)."""

    lift: FloatArray

    @property
    def outside(self) -> int:
        return 0

    def __call__(self, C: FloatArray) -> tuple[FloatArray, FloatArray]:
        return C @ self.lift.T, np.zeros((len(C), 0))


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """Orthogonal projection on modes (n, q) that do not span the atoms; inverse (q, n): left
    inverse of the modes. Coefficients of inactive atoms are zero, and take no time: rows of `atoms`
    (k, n), not columns, are read, which are contiguous."""

    atoms: FloatArray
    modes: FloatArray
    inverse: FloatArray

    @classmethod
    def from_atoms(cls, atoms: FloatArray, space: ErrorSpace) -> "Projected":
        """Projection of states in atoms (n, k). The columns of modes norm^-1 are orthonormal,
        because |modes x| = |norm x|."""
        orthonormal = np.linalg.solve(space.norm.T, space.modes.T)
        inverse = np.linalg.solve(space.norm, orthonormal)
        return cls(np.ascontiguousarray(atoms.T), space.modes, inverse)

    @property
    def outside(self) -> int:
        return len(self.modes)

    def __call__(self, C: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (j, q) of coefficients C (j, k), and what the modes leave of the states, (j,
        n). atoms (k, n): one atom a row; inverse (q, n): left inverse of the modes (n, q)."""
        active = np.flatnonzero(C.any(axis=0))
        many = 2 * len(active) > C.shape[1]
        rest = C @ self.atoms if many else C[:, active] @ self.atoms[active]
        z = np.zeros((len(C), self.modes.shape[1]))
        for _ in range(2):  # the second pass removes what rounding left of the first
            part = rest @ self.inverse.T
            z += part
            rest = rest - part @ self.modes.T
        return z, rest


def ranges(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Range of each block in a vector of all of them in turn."""
    ends = np.cumsum([0, *sizes.values()]).tolist()
    return {n: slice(i, j) for n, i, j in zip(sizes, ends[:-1], ends[1:], strict=True)}
