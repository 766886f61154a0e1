"""Assembled model: layout of the unknowns, equations of motion and heat, initial values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray, union
from sparsemor.core.model.factorizations import BlockSolvers
from sparsemor.core.protocols.basis import BlockData
from sparsemor.core.protocols.body import Body, BodyShape, Part, ProbePlace
from sparsemor.core.protocols.connector import Connector
from sparsemor.core.protocols.contact import Contact
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.joint import Joint
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.linear_solver import DofLocations, Factorized, LinearSolver
from sparsemor.core.protocols.load_tables import LoadTable, path_rows, ring
from sparsemor.core.protocols.prescribed_motion import Stage
from sparsemor.core.protocols.reducer import AssembledModel, StepFactors
from sparsemor.core.protocols.separable import ElasticOperators, HeatBody, LoadColumn, Separated
from sparsemor.core.protocols.term import Term
from sparsemor.core.registry.boundary import read_only


@dataclass(frozen=True, slots=True, eq=False)
class Model(AssembledModel):
    """Assembled model: layout of the unknowns, equations, initial values x0 and rates v0 (n,).

    by_part: residual terms by the body, joint, contact or load that contributes them; separated:
    the same equations as operators of each block of unknowns (one field of one body). required:
    block -> row numbers in the block that joints and localized loads act on; loaded: block -> joint
    or load -> its row numbers. probes: material points whose motion and temperature are recorded;
    geometry: block -> node coordinates (n, d), m, and components (n,) of its unknowns. solvers:
    linear solvers of the blocks' constant matrices. stage: rigid-body pre-simulation from which
    prescribed motion, reactions and surface loads come, or None. starts: the consistent initial
    state, once it is computed (core/model/initial_state.py); a modified copy of the model computes
    its own. stress_checks: body -> sizes of its largest displacement and change of temperature, and
    change of stiffness, in a state that was checked (plugins/checks/stress_stiffness.py).
    blocks_data: block -> its `block_data`, once it is put together. made: of `once`.
    """

    layout: Layout
    parts: Mapping[str, Part]
    by_part: Mapping[str, tuple[Term, ...]]
    separated: Separated
    x0: FloatArray
    v0: FloatArray
    required: Mapping[str, IntArray]
    loaded: Mapping[str, Mapping[str, IntArray]]
    probes: tuple[ProbePlace, ...]
    geometry: Mapping[str, tuple[FloatArray, IntArray]]
    solvers: BlockSolvers
    stage: Stage | None = None
    starts: list[State] = field(default_factory=list, init=False, repr=False)
    blocks_data: dict[str, BlockData] = field(default_factory=dict, init=False, repr=False)
    made: dict[object, Any] = field(default_factory=dict, init=False, repr=False)
    stress_checks: dict[str, tuple[float, float, float]] = field(
        default_factory=dict, init=False, repr=False)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Residual terms of all bodies, joints, contacts and loads."""
        return tuple(chain.from_iterable(self.by_part.values()))

    def shapes(self) -> dict[str, BodyShape]:
        """Mesh and field data of each body that has a mesh."""
        return {n: shape for n, body in self.bodies.items()
                if (shape := body.shape()) is not None}

    @property
    def bodies(self) -> dict[str, Body]:
        return {n: part for n, part in self.parts.items() if isinstance(part, Body)}

    @property
    def connectors(self) -> dict[str, Connector]:
        """Joints, contacts and loads."""
        return {n: part for n, part in self.parts.items() if isinstance(part, Connector)}

    @property
    def joints(self) -> dict[str, Joint]:
        return {n: part for n, part in self.parts.items() if isinstance(part, Joint)}

    @property
    def contacts(self) -> dict[str, Contact]:
        return {n: part for n, part in self.parts.items() if isinstance(part, Contact)}

    @property
    def multiplier_components(self) -> dict[str, tuple[tuple[str, str], ...]]:
        """Multiplier block of a joint -> name and unit of each Lagrange multiplier, for joints that
        name them."""
        found = {}
        for name, joint in self.joints.items():
            block = self.layout.multipliers(name)
            if block is not None and joint.components:
                names, units = zip(*joint.components, strict=True)
                found[block.name] = tuple(zip(distinct_names(list(names)), units, strict=True))
        return found

    def reducible(self) -> tuple[str, ...]:
        return self.layout.reducible

    def places(self, name: str) -> DofLocations:
        """Node coordinates and components of the unknowns of an elastic or thermal block."""
        return DofLocations(*self.geometry[name])

    def factorize(
        self, name: str, A: Csr, purpose: str = "steps", places: DofLocations | None = None
    ) -> Factorized:
        """Factorization of a matrix A (n, n) of an elastic or thermal block by the linear solver
        that the user chose for it."""
        return self.solvers.factorize(
            name, A, self.places(name) if places is None else places, purpose)

    def block_data(
        self, name: str, snapshots: FloatArray | None = None, step: StepFactors | None = None
    ) -> BlockData:
        """Matrices, load vectors and node coordinates of one elastic or thermal block, from which
        trial bases and row samples are built.

        snapshots: (n, M), if there are any; step: size and factors of the time steps that the block
        is reduced for. Nothing is solved: matrices are passed on, load vectors become columns of
        one array.
        """
        if name not in self.blocks_data:
            self.blocks_data[name] = read_only(self._block_data(name))  # plugins share it
        data = self.blocks_data[name]
        if step is not None:
            data = replace(
                data, step=step.h, heat=data.heat and self.block_data(data.heat.name, step=step),
                factors=(step.c1, step.c2) if data.order == 2 else (0.0, step.c1_first))
        return data if snapshots is None else replace(data, snapshots=snapshots)

    def _block_data(self, name: str) -> BlockData:
        """Data of a block without snapshots and step: matrices of a temperature block (`h`) or an
        elastic one (`m`), with its loads side by side. geometry: coordinates (n, d), m, of the node
        and component (n,) of each unknown. Raises KeyError for any other block."""
        coordinates, component = self.geometry[name]
        data = partial(
            BlockData, name=name, coordinates=coordinates, component=component,
            snapshots=np.zeros((len(component), 0)), start=self.x0[self.layout[name]],
            ring=self.ring(name), moving=self.moving(name), solver=self.linear_solver(name))
        for h in self.separated.heat:
            if h.thermal == name:
                loads, names, _ = _loads([
                    (h.loads, h.columns or _columns(h.loads)), _constant(h.constant)])
                return data(order=1, mass=h.capacity, stiffness=h.conductivity, loads=loads,
                            load_names=names)
        for m in self.separated.moving:
            if m.elastic == name and m.operators is not None:
                ops = m.operators
                loads, names, joints = _loads([
                    (ops.directions, ops.columns or _columns(ops.directions)),
                    (ops.loads, _columns(ops.loads, ops.load_names)), _constant(ops.constant)])
                coupled = ops.coupling is not None and m.thermal in self.layout
                return data(
                    mass=ops.mass, stiffness=ops.stiffness, loads=loads, load_names=names,
                    joints=joints, interface=self._interface(name),
                    coupling=ops.coupling if coupled else None,
                    heat=self.block_data(m.thermal) if coupled else None, damping=ops.damping,
                    tangent=partial(ops.tangent, T=self.x0[self.layout.numbers(m.thermal)]) if (
                        ops.local) else None)
        raise KeyError(name)

    def linear_solver(self, name: str) -> LinearSolver:
        """Linear solver of a block."""
        return self.solvers.of(name)

    def with_separated(self, separated: Separated) -> "Model":
        """Copy of the model with other block operators `separated`; its consistent initial state is
        computed again."""
        return replace(self, separated=separated)

    def moving(self, name: str) -> tuple[LoadTable, ...]:
        """Loads on a block whose point of application moves over the body."""
        source = self._operators(name)
        return () if source is None else source.tables

    def ring(self, name: str) -> IntArray:
        """Sorted rows of a block that belong to elements along the path of moving loads and
        contacts; a load or contact moves over the body if its `moving` is True. moving(name):
        tabulated loads that move over the block; loaded: block -> joint, load or contact -> rows
        that it acts on."""
        connectors = self.connectors
        path = union([path_rows(self.moving(name)), *(
            rows for part, rows in self.loaded[name].items() if connectors[part].moving)])
        source = self._operators(name)
        if source is None or not len(path):
            return np.zeros(0, np.int64)
        pair = ((source.capacity, source.conductivity) if isinstance(source, HeatBody) else
                (source.mass, source.stiffness))
        return ring(*pair, self.geometry[name][0], path)

    def _operators(self, name: str) -> HeatBody | ElasticOperators | None:
        """Operators of a temperature or elastic block; None for any other."""
        for h in self.separated.heat:
            if h.thermal == name:
                return h
        return next((m.operators for m in self.separated.moving if m.elastic == name), None)

    def _interface(self, name: str) -> IntArray:
        """Sorted row numbers of a block that joints act on."""
        return union(rows for part, rows in self.loaded[name].items()
                     if self.layout.multipliers(part) is not None)


Columns = tuple[LoadColumn, ...]


def _columns(matrix: FloatArray, names: tuple[str, ...] = ()) -> Columns:
    """Descriptions of external load columns (n, j), none of which is a joint force."""
    return tuple(map(LoadColumn, names or [f"load {i}" for i in range(matrix.shape[1])]))


def _constant(vector: FloatArray) -> tuple[FloatArray, Columns]:
    """Constant load (n,) as one column (n, 1), with its description."""
    return vector[:, None], (LoadColumn("constant part"),)


def _loads(
    groups: list[tuple[FloatArray, Columns]]
) -> tuple[FloatArray, tuple[str, ...], IntArray]:
    """Nonzero load columns (n, j) of all groups side by side, their distinct names, and the numbers
    of the columns that are joint forces. Columns without a name are no loads and are left out."""
    matrices, kept = [], list[LoadColumn]()
    for matrix, columns in groups:
        nonzero = [i for i, c in enumerate(columns) if c.name and matrix[:, i].any()]
        matrices.append(matrix[:, nonzero])
        kept += [columns[i] for i in nonzero]
    joints = np.flatnonzero([c.joint for c in kept]).astype(np.int64)
    return np.concatenate(matrices, axis=1), distinct_names([c.name for c in kept]), joints


def distinct_names(names: list[str]) -> tuple[str, ...]:
    """The names in order, repeated ones with a number: "push", "push (2)"."""
    count_of: dict[str, int] = {}
    found = []
    for name in names:
        count_of[name] = count_of.get(name, 0) + 1
        found.append(name if count_of[name] == 1 else f"{name} ({count_of[name]})")
    return tuple(found)
