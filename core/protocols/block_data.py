"""Data of one reducible block, and its dictionary of atoms."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.linear_solver import DofLocations, LinearSolver
from sparsemor.core.protocols.load_tables import LoadTable


@dataclass(frozen=True, slots=True, eq=False)
class BlockData:
    """Data of one reducible block (one field of one body) from which it is reduced.

    snapshots (n, M) unknowns in columns (empty (n, 0) when the reducer needs none);
    order: of its equations in time; mass, stiffness: (n, n) csr of the constant operators
    (capacity, conductivity for heat);
    coordinates (n, d): reference position of each unknown's node, m; component (n,): 0..d-1 for
    displacements, 0 for temperature; loads (n, j): constant load vectors, unit amplitude: given
    forces or heat, inertia, weight, joint forces, and the constant part; load_names (j,): what
    each is ("gravity y", "joint B x"), all different.
    joints: numbers of the columns of `loads` that are joint forces: P with s = P^T u the
    displacements that the joints see; interface: rows that they act on. start (n,): unknowns at
    the start. Thermoelastic bodies: coupling (n, nT), loads = coupling @ temperatures, and
    `heat`, the data of the thermal block (without snapshots); None elsewhere.
    moving: loads whose place on the body changes; ring: rows of all elements that touch their
    path, sorted. step: size h of the steps it is reduced for, s, and factors: what such a step
    multiplies `damping` (None: zero) and `mass` by, c1 and c2 of its formula, or 0 and the c1 of
    first-order unknowns for heat, whose mass is its capacity. All 0 where no step is known.
    solver: who solves with these matrices; None leaves it to the basis.
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

    @property
    def size(self) -> int:
        return int(self.coordinates.shape[0])

    @property
    def places(self) -> DofLocations:
        return DofLocations(self.coordinates, self.component)

    @property
    def operator(self) -> Csr:
        """D = K + c1 D_m + c2 M, or B = K_T + c1 C: what a step solves with, (n, n)."""
        c1, c2 = self.factors
        D = self.stiffness + c2 * self.mass
        return D if self.damping is None else D + c1 * self.damping


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """x = offset + atoms @ c. atoms (n, k) have unit columns; provenance names each of them.

    `info` holds what the basis wants reported (numbers and strings only).
    """

    atoms: FloatArray
    offset: FloatArray
    provenance: tuple[str, ...]
    info: Mapping[str, float | int | str] = field(default_factory=dict)
