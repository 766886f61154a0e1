"""Contract of trial bases, sets of trial vectors (atoms) for one block of unknowns; the matrices,
loads and snapshots from which they are built."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.linear_solver import DofLocations, LinearSolver
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.plugin import Plugin


@dataclass(frozen=True, slots=True, eq=False)
class BlockData:
    """Data from which one elastic or thermal block of a body, with n unknowns, is reduced.

    snapshots: (n, M), or (n, 0) if the reducer needs none.
    order: order in time of the equations.
    mass, stiffness, damping: (n, n) csr; capacity and conductivity for heat; damping None: zero.
    coordinates: (n, d) reference position of each unknown's node, m.
    component: (n,) 0..d-1 for displacements, d and up for rotations, -1 for modal coordinates, 0
        for temperatures.
    loads: (n, j) unit load vectors: forces or heat, inertia, weight, joint forces, constant load.
    load_names: (j,) distinct descriptions ("gravity y", "joint B x").
    joints: numbers of the joint-force columns P of `loads`; P^T u are displacements at the joints.
    interface: rows that joints act on.
    start: (n,) initial values.
    coupling, heat: for thermoelastic bodies, (n, nT) with thermal load = coupling @ temperatures,
    and the data of the temperature block without snapshots; else None.
    moving: loads whose point of application moves over the body.
    ring: sorted rows of all elements along their path.
    step: time step h, s; factors: factors of damping and mass in the matrix of a time step, c1 and
    c2 of the step formula, or for heat 0 and the c1 of first-order unknowns; 0 if not known.
    solver: linear solver for these matrices; None: chosen by the basis.
    tangent: stiffness (n, n) of the local terms, such as nonlinear strains, at displacements (n,)
        and the temperatures of the start; None without such terms.
    """

    name: str
    snapshots: FloatArray
    mass: Csr
    stiffness: Csr
    coordinates: FloatArray
    component: IntArray
    loads: FloatArray
    load_names: tuple[str, ...] = ()
    joints: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    interface: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    start: FloatArray = field(default_factory=lambda: np.zeros(0))
    coupling: Csr | None = None
    heat: "BlockData | None" = None
    moving: tuple[LoadTable, ...] = ()
    ring: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    damping: Csr | None = None
    factors: tuple[float, float] = (0.0, 0.0)
    step: float = 0.0
    solver: LinearSolver | None = None
    order: Literal[1, 2] = 2
    tangent: Callable[[FloatArray], Csr] | None = None

    @property
    def size(self) -> int:
        return int(self.coordinates.shape[0])

    @property
    def places(self) -> DofLocations:
        return DofLocations(self.coordinates, self.component)

    @property
    def operator(self) -> Csr:
        """Matrix (n, n) of a time step: K + c1 D + c2 M for displacements (D: damping), K_T + c1 C
        for temperatures."""
        c1, c2 = self.factors
        D = self.stiffness + c2 * self.mass
        return D if self.damping is None else D + c1 * self.damping


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """Trial basis of one block, x = offset + atoms @ c, offset (n,), coefficients c (k,). atoms
    (n, k) have unit columns; provenance: the origin of each column in words.

    info: numbers and strings that the basis reports.
    """

    atoms: FloatArray
    offset: FloatArray
    provenance: tuple[str, ...]
    info: Mapping[str, float | int | str] = field(default_factory=dict)

    def leading(self, count: int) -> "Dictionary":
        """The first `count` atoms."""
        return replace(self, atoms=np.ascontiguousarray(self.atoms[:, :count]),
                       provenance=self.provenance[:count])


class Basis(Plugin):
    """Trial basis of one block of unknowns, built from its snapshots or its matrices."""

    @property
    def needs_snapshots(self) -> bool:
        """True if `build` reads `data.snapshots`, so that a training run is required."""
        return True

    @property
    def has_offset(self) -> bool:
        """True if states are counted from an offset of the dictionary, such as the mean of the
        snapshots."""
        return False

    @abstractmethod
    def build(self, data: BlockData) -> Dictionary:
        """Dictionary of a block. Raises InputError for a block that it does not suit."""

    def most_atoms(self, size: int) -> int | None:
        """Largest number of atoms (trial vectors) for a block of `size` unknowns; None if the
        options do not bound it."""
        return None

    def unfit(self, data: BlockData) -> str:
        """Reason why `build` would reject the block, whose `data` have no snapshots yet; "" if it
        would not, or if only the snapshots can show it."""
        return ""

    def fitting(self, data: BlockData) -> "Basis | None":
        """What remains of this basis for a block that it does not fit: of a basis made of others,
        those that do; None if nothing remains."""
        return None
