"""Body from matrices of another code: mass, stiffness, damping, heat, nodes, without a mesh."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.linalg import null_space
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem.field_matrices import Elasticity, Heat
from sparsemor.bodies.flexible import Damping
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.initial_pose import Pose
from sparsemor.bodies.matrices import matrix_checks
from sparsemor.bodies.matrices.displacement_unknowns import Unknowns
from sparsemor.bodies.matrices.formats import FileMatrix, whole
from sparsemor.bodies.matrices.matrix_body import MatrixBody, NodalLoads, mass_properties
from sparsemor.bodies.matrices.matrix_files import (
    TABLES,
    FileNodes,
    files_of,
    read_matrix,
    read_nodes,
    read_table,
    read_unknowns,
    symmetric,
)
from sparsemor.bodies.mesh.coordinate_expressions import FormulaText, evaluate_formula
from sparsemor.bodies.mesh.formats.file_content import Numbering
from sparsemor.bodies.mesh.point_sets import PointSet, find_set, given_centres, with_sets
from sparsemor.bodies.reference_conditions import Reference
from sparsemor.bodies.terms.field_kinds import BODY_KINDS, ELASTIC, THERMAL
from sparsemor.core import (
    BodyPlugin,
    Csr,
    Fault,
    FieldKind,
    FloatArray,
    Gather,
    InputError,
    IntArray,
    Mesh,
    Note,
    Plugin,
    information,
)

MECHANICAL, THERMAL_KEYS = ("mass", "stiffness", "damping_matrix"), ("conductivity", "capacity")


LARGEST = 30_000_000
"""Number of entries of the shapes of condensed unknowns above which a body is refused."""


class NodeSet(PointSet):
    """Named set of nodes: by their numbers, or as in meshes by `box`, `where` or `nearest`; or the
    centre of a set of the file."""

    nodes: list[int] | None = Field(default=None, min_length=1)
    """Numbers of the nodes in the file."""
    weights: list[float] | None = Field(default=None, min_length=1)
    """Weights of `nodes` in the mean displacement of the set, such as those of a distributing
    coupling (RBE3); equal by default."""

    # options of which a set has one
    ways: ClassVar[tuple[str, ...]] = ("nodes", *PointSet.ways)

    @model_validator(mode="after")
    def _weighted(self) -> "NodeSet":
        count = 0 if self.nodes is None else len(self.nodes)
        if self.weights is not None and (len(self.weights) != count or min(self.weights) <= 0.0):
            raise InputError(f"give a positive weight for each of the {count} `nodes`", "weights")
        return self


class FileUnits(Plugin):
    """Units of the matrices and nodes in SI units; seconds and kelvins in any case."""

    length: float = Field(default=1.0, gt=0)
    """Metres per length unit: 1e-3 for mm."""
    mass: float = Field(default=1.0, gt=0)
    """Kilograms per mass unit: 1e3 for t, as with N and mm."""


@dataclass(frozen=True, slots=True, eq=False)
class _Files:
    """Content of the files in SI units, of n unknowns in one order; mechanical, thermal: option ->
    matrix; shapes (n, k): displacements by k generalized coordinates, of which the stiffness and
    damping matrices then are, None without; coupling (n, N): forces by nodal temperatures."""

    nodes: FileNodes
    unknowns: Unknowns
    shapes: FloatArray | None
    mechanical: Mapping[str, Csr]
    thermal: Mapping[str, Csr]
    coupling: Csr | None
    notes: tuple[Note, ...]


class Matrices(BodyPlugin):
    """Flexible body from matrices of another code in a floating frame of reference, without a mesh.

    Files are `.npy`, `.npz`, `.mat`, `.mtx` (Matrix Market, or `*MATRIX GENERATE` of Abaqus),
    `.sti` and `.mas` (CalculiX) or `.pch` (Nastran), with `:NAME` for one of several arrays.
    Unknowns are displacements of nodes, rotations of nodes, and modal coordinates, as of a
    superelement. Matrices are those of the free body, without supports.
    """

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    nodes: str = Field(min_length=1)
    """File of the nodes: an array (N, 2 or 3), numbered from 1; a `.csv` or `.txt` with lines
    `number, x, y, z`; an Abaqus or CalculiX `.inp`, whose node sets are sets of the body; Nastran
    bulk data."""
    mass: str | None = None
    """File of the mass matrix M; not needed for heat alone."""
    stiffness: str | None = None
    """File of the stiffness matrix K."""
    damping_matrix: str | None = None
    """File of the viscous damping matrix C."""
    conductivity: str | None = None
    """File of the conductivity matrix K_T, one temperature for each node."""
    capacity: str | None = None
    """File of the heat capacity matrix C_T."""
    coupling: str | None = None
    """File of the thermal forces K_fT (unknowns, nodes), N/K."""
    load_vectors: dict[str, str] = {}
    """Files of nodal loads by name, for the load `load_vector`: lines `node, direction, value` of a
    `.csv` or `.txt`, with directions 1 to 3 of forces, 4 to 6 of moments and 11 of heat; or an
    array with a row of forces, or of forces and moments, for each node."""
    unknowns: str | None = None
    """File with a row of node and direction (1 to 3 displacements, 4 to 6 rotations) for each
    unknown, node 0 for one without a place. By default as the matrix file says, or the same
    directions at all nodes in their order, followed by `modes`."""
    modes: int = Field(default=0, ge=0)
    """Number of unknowns without a place at the end, such as those of fixed-interface modes."""
    shapes: str | None = None
    """File of the shapes (n, k) of k generalized coordinates, as values of all n unknowns of the
    nodes: of constraint modes and fixed-interface modes, or of eigenmodes. `stiffness` and
    `damping_matrix` are then those of the coordinates, or of all unknowns; `mass` is that of all
    unknowns, or the masses of the nodes (N, 1)."""
    units: FileUnits = FileUnits()
    """Units of the files."""
    sets: dict[str, NodeSet] = {}
    """Additional named sets of nodes."""
    fields: list[Literal["elastic", "thermal"]] | None = None
    """Fields of the body; by default those whose matrices are given, and `[]`: a rigid body."""
    reference: Reference | None = None
    """Reference conditions of the elastic field; not needed in a fixed frame if the matrices are
    supported."""
    damping: Damping = Damping()
    """Rayleigh and modal damping of the elastic field, added to `damping_matrix`."""
    frame: Literal["floating", "fixed", "spinning"] = "floating"
    """Motion of the body frame. `fixed`: it stays at its pose and has no unknowns. `spinning`: in
    space, it rotates about the z axis alone, by an angle."""
    pose: Pose = Pose()
    """Initial position and rotation of the frame, and their rates."""
    reference_temperature: float = 293.15
    """Stress-free temperature, K."""
    initial_temperature: float | FormulaText | None = None
    """Initial temperature, K, a number or a formula in x, y (and z); the reference temperature when
    not given."""

    @model_validator(mode="after")
    def _complete(self) -> "Matrices":
        """Checks that the matrices of all fields are given, and a reference condition where one is
        needed: for an elastic field whose matrices are those of a free body (not `_supported`), but
        for `shapes`, which may exclude rigid motion themselves (checked in the build)."""
        missing = [key for field, keys in ((ELASTIC.name, ("stiffness", "mass")),
                                           (THERMAL.name, THERMAL_KEYS))
                   if field in self.selected_fields
                   for key in keys if getattr(self, key) is None]
        if self.frame != "fixed" and self.mass is None and "mass" not in missing:
            missing.append("mass")
        if missing:
            raise InputError(f"the matrices {', '.join(dict.fromkeys(missing))} are missing")
        if ELASTIC.name in self.selected_fields and not self._supported and (
                self.reference is None and self.shapes is None):
            raise InputError("missing: the elastic field needs a reference condition, such as "
                             "{clamp: left} or {chord: [a, b]}, or its displacements hold rigid "
                             "motion", "reference")
        return self

    @property
    def _supported(self) -> bool:
        """True if the matrices may be those of a body with supports."""
        return self.frame == "fixed" and self.reference is None

    @property
    def immobile(self) -> bool:
        return self.frame == "fixed" and ELASTIC.name not in self.selected_fields

    @property
    def selected_fields(self) -> Sequence[str]:
        if self.fields is not None:
            return self.fields
        return [name for name, key in ((ELASTIC.name, "stiffness"), (THERMAL.name, "conductivity"))
                if getattr(self, key) is not None]

    @property
    def stored_classes(self) -> Sequence[object]:
        from sparsemor.bodies.stored_classes import CLASSES

        return CLASSES

    def files(self, base: Path) -> Sequence[Path]:
        """All files: their content identifies a run and its cached results."""
        named = (self.nodes, self.unknowns, self.coupling, self.shapes,
                 *self.load_vectors.values(), *(
            getattr(self, key) for key in (*MECHANICAL, *THERMAL_KEYS)))
        return list(dict.fromkeys(f for n in named if n for f in files_of(base, n)))

    def build(self, name: str, base: Path) -> MatrixBody:
        """The body of the files in the folder `base`; faults are collected and raised together.

        u: unknowns of the files, nodal displacements and rotations, and coordinates without a
        place. fixed: those that the reference conditions remove, None without an elastic field; the
        generalized coordinates of `shapes` meet the conditions by a change of basis (`basis`).
        massive: the free unknowns with mass; the others are condensed statically."""
        files = self._read(base)
        u, has_heat = files.unknowns, THERMAL.name in self.selected_fields
        mesh = self._points(files)
        gather = Gather()
        centres = gather("sets", given_centres, mesh, self.sets)
        weights = gather("sets", self._weights, files.nodes)
        loads = {key: gather(f"load_vectors.{key}", self._loads, base, text, files)
                 for key, text in self.load_vectors.items()}
        T0 = gather("", self._initial_temperature, mesh.points)
        start = gather("", self.pose.start, u.d, self.frame == "spinning" and u.d == 3)
        if self.frame == "spinning" and u.d == 2:
            gather.faults.append(Fault("frame", "the nodes are plane: its frame is `floating`"))
        fixed = gather("", self._fixed, mesh, u)
        basis = None if fixed is None or files.shapes is None else gather(
            "", self._constrained_basis, files.shapes, fixed, u)
        inertia = gather("", self._inertia, files.mechanical, u)
        massive: IntArray | None = None
        if fixed is not None and files.shapes is None:
            free = np.setdiff1d(np.arange(u.size), fixed)
            massive = free[matrix_checks.have_mass(files.mechanical["mass"])[free]]
            gather("mass", matrix_checks.check_masses, str(self.mass), files.mechanical["mass"],
                   massive)
        gather("", self._check, files, mesh)
        gather.check()
        assert centres is not None and weights is not None and T0 is not None
        assert start is not None
        M = files.mechanical.get("mass")
        if fixed is not None and massive is not None and len(massive) + len(fixed) < u.size:
            files, basis = self._condensed(files, fixed, massive)
        else:
            massive = None
        shapes = None if basis is None or files.shapes is None else files.shapes @ basis
        return MatrixBody(
            name=name, folder=base, X=mesh.points, inertia=inertia, pose=start[0],
            velocity=start[1], moves=self.frame != "fixed", points=mesh.point_sets,
            centres=centres, weights=weights,
            load_vectors={key: one for key, one in loads.items() if one is not None},
            declared=self.sets, unknowns=u, mass=M, shapes=shapes, coordinates=massive,
            elasticity=None if fixed is None else self._elasticity(files, fixed, basis),
            heat=Heat(np.arange(len(mesh.points)), files.thermal["capacity"],
                      files.thermal["conductivity"]) if has_heat else None,
            T0=T0, T_ref=np.full(len(mesh.points), self.reference_temperature),
            mesh_notes=(*files.notes, *self._notes(name, files, inertia)))

    # ------------------------------------------------------------------ files

    def _read(self, base: Path) -> _Files:
        """Nodes and matrices of the files in SI units, with their sizes checked; with `shapes`
        those of the stiffness are reduced to them."""
        gather = Gather()
        nodes = gather("", read_nodes, base, self.nodes, "nodes")
        given = gather("", read_unknowns, base, self.unknowns, "unknowns") if self.unknowns else (
            np.zeros((0, 2), np.int64))
        read = {key: gather("", read_matrix, base, text, key)
                for key in (*MECHANICAL, *THERMAL_KEYS, "coupling", "shapes")
                if (text := getattr(self, key)) is not None}
        gather.check()
        assert nodes is not None and given is not None
        found = {k: m for k, m in read.items() if m is not None}
        # T (n, k): shapes; mass is (n, n), stiffness and damping are (k, k) or reduced to that
        N, T = len(nodes.labels), found["shapes"].matrix.toarray() if "shapes" in found else None
        if T is not None and found.get("mass") and found["mass"].matrix.shape == (N, 1):
            each = np.repeat(found["mass"].matrix.toarray().ravel(), nodes.X.shape[1])
            found["mass"] = FileMatrix(diags_array(each, format="csr"))
        labels, same = self._labels(nodes, given, {
            k: found[k] for k in MECHANICAL[: None if T is None else 1] if k in found})
        used = np.isin(nodes.labels, labels[:, 0])
        alone = information(f"{self.nodes}: {np.count_nonzero(~used)} nodes "
                            f"({matrix_checks.some(nodes.labels[~used])}) have no unknowns, and are"
                            " left out", "matrix_nodes")
        drops = T is None and not self._supported and used.any() and not used.all() and (
            ELASTIC.name in self.selected_fields) and not any(k in found for k in THERMAL_KEYS)
        nodes = nodes.only(used) if drops else nodes
        u, notes = self._unknowns(nodes, labels)
        notes = (*notes, alone) if drops else notes
        n = u.size
        if T is not None and len(T) != n:
            raise InputError(f"'{self.shapes}' has {len(T)} rows, and the mass matrix "
                             f"'{self.mass}' {n}: with shapes it is that of all unknowns of the "
                             "nodes, or the masses of the nodes (N, 1)", "shapes")
        k = n if T is None else T.shape[1]
        for key in MECHANICAL[1:]:
            if T is not None and key in found:
                A = found[key].matrix
                same[key] = csr_array(T.T @ (A @ T)) if A.shape == (n, n) and k != n else A
        for key, shape, what in (
                ("mass", (n, n), f"{n} unknowns"), ("coupling", (n, N), f"{n} unknowns"),
                *((key, (k, k), f"{k} {'unknowns' if T is None else 'shapes'}")
                  for key in MECHANICAL[1:]),
                *((key, (N, N), f"{N} nodes") for key in THERMAL_KEYS)):
            m = same.get(key, found[key].matrix if key in found else None)
            if m is not None and m.shape != shape:
                gather.faults.append(Fault(key, f"'{getattr(self, key)}' is {m.shape[0]} x "
                                           f"{m.shape[1]}, and the body has {what}: {shape[0]} x "
                                           f"{shape[1]} is needed"))
        gather.check()
        # unknowns in metres: a matrix A of energy x.A x becomes energy * by A by (s and K stay)
        energy = self.units.mass * self.units.length**2
        into_metres = diags_array(np.where((u.component >= 0) & (u.component < u.d),
                                  1.0 / self.units.length, 1.0))
        into_metres = into_metres @ diags_array(self._scale(u, same.get("mass")))
        into = {key: into_metres if T is None or key == "mass" else eye_array(k) for key in same}
        mechanical = {key: gather("", symmetric, getattr(self, key),
                                  (energy * into[key] @ m @ into[key]).tocsr(), key)
                      for key, m in same.items()}
        thermal = {k: gather("", symmetric, getattr(self, k), energy * found[k].matrix, k)
                   for k in THERMAL_KEYS if k in found}
        gather.check()
        whole = {k: m for k, m in mechanical.items() if m is not None}
        forces = (energy * into_metres @ found["coupling"].matrix).tocsr() if (
            "coupling" in found) else None
        return _Files(nodes, u, None if T is None else T / into_metres.diagonal()[:, None], whole,
                      {k: m for k, m in thermal.items() if m is not None}, forces, notes)

    def _scale(self, u: Unknowns, M: Csr | None) -> FloatArray:
        """(n,) factors of the coordinates without a place, which make them displacements, m, whose
        kinetic energy is that of the whole mass."""
        scale = np.ones(u.size)
        if M is not None and len(u.modal):
            own, along = M.diagonal()[u.modal], u.rigid_modes[:, : u.d]
            whole = float(np.trace(along.T @ (M @ along))) / u.d
            scale[u.modal] = np.sqrt(np.where(own > 0.0, max(whole, 0.0) / np.where(
                own > 0.0, own, 1.0), 1.0)) / self.units.length
        return scale

    def _labels(
        self, nodes: FileNodes, given: IntArray, read: Mapping[str, FileMatrix]
    ) -> tuple[IntArray, dict[str, Csr]]:
        """(n, 2) node and direction of each unknown, and the matrices in their order.

        given (n, 2), or (0, 2): labels of the file of unknowns, if any, which precede those of the
        matrix files; read: option -> matrix of its file. A file without labels of its own is taken
        as in this order already.
        """
        named = {k: m for k, m in read.items() if len(m.labels)}
        labels = given
        if not len(given) and named:
            labels = np.unique(np.concatenate([m.labels for m in named.values()]), axis=0)
        elif not len(given) and read:
            labels = self._in_order(nodes, *next(iter(read.items())))
        found = {}
        for key, m in read.items():
            at = _rows(labels, m.labels, key, getattr(self, key)) if key in named else np.arange(
                m.matrix.shape[0])
            wide = m.matrix.tocoo()
            n = len(labels) if key in named else m.matrix.shape[0]
            found[key] = csr_array((wide.data, (at[wide.row], at[wide.col])), shape=(n, n))
        return labels, found

    def _in_order(self, nodes: FileNodes, key: str, m: FileMatrix) -> IntArray:
        """Labels (n, 2) of the unknowns of a matrix m, given as `key`, whose file does not name
        them: the same directions at all nodes, in their order, then `modes` with node and direction
        0. InputError where their number does not fit, or the nodes are not in ascending order."""
        N, n = len(nodes.labels), m.matrix.shape[0] - self.modes
        d = nodes.X.shape[1]
        # number of unknowns of the nodes -> directions at each of them
        each = {2 * N: (1, 2), d * N: tuple(range(1, d + 1)), 6 * N: (1, 2, 3, 4, 5, 6)}
        if d == 2:
            each[3 * N] = (1, 2, 6)
        if n not in each:
            raise InputError(
                f"'{getattr(self, key)}' has {m.matrix.shape[0]} unknowns, which is no multiple of "
                f"the {N} nodes by 2, 3 or 6{f', and {self.modes} modes' * bool(self.modes)}: say "
                "with `unknowns` to which node and direction each belongs", key)
        if (np.diff(nodes.labels) < 0).any():
            raise InputError(
                f"the nodes of '{self.nodes}' are not in the order of their numbers, and "
                f"'{getattr(self, key)}' does not say to which each row belongs: say so with "
                "`unknowns`", "nodes")
        directions = each[n]
        labels = np.column_stack([np.repeat(nodes.labels, len(directions)),
                                  np.tile(directions, N)])
        return np.concatenate([labels, np.zeros((self.modes, 2), np.int64)]).astype(np.int64)

    def _unknowns(self, nodes: FileNodes, labels: IntArray) -> tuple[Unknowns, tuple[Note, ...]]:
        """Unknowns of the rows of the matrices, by labels (n, 2) of node number and direction (node
        0: none); in the plane where all are in it. With notes on nodes without a position."""
        X, notes = nodes.X, []
        node = nodes.numbering.rows(labels[:, 0])
        away = np.setdiff1d(labels[node < 0, 0], [0])
        if away.size:
            notes.append(information(
                f"{self.nodes}: {away.size} nodes of the matrices ({matrix_checks.some(away)}) have"
                " no position: their unknowns are coordinates without a place", "matrix_nodes"))
        if X.shape[1] == 3 and len(labels) and np.isin(labels[node >= 0, 1], (1, 2, 6)).all():
            if np.ptp(X[:, 2]) > 1e-9 * float(np.ptp(X, axis=0).max()):
                raise InputError(f"'{self.nodes}': the matrices are of displacements along x and "
                                 f"y alone, and its nodes have z from {X[:, 2].min():.6g} to "
                                 f"{X[:, 2].max():.6g}", "nodes")
            X = X[:, :2]
        try:
            return Unknowns.of_labels(self.units.length * X, node, labels[:, 1]), tuple(notes)
        except InputError as error:
            raise error.under("unknowns" if self.unknowns else "stiffness") from None

    # ------------------------------------------------------------------ parts of the body

    def _points(self, files: _Files) -> Mesh:
        """Nodes and sets as a mesh without cells: sets of the file, those by node numbers, and
        those by geometry (`with_sets`)."""
        named = dict(files.nodes.sets)
        # at.rows: row of a node number in unknowns.X, -1 for none; files.nodes has the rows of X,
        # without nodes that were left out as they have no unknowns, of which `notes` tell
        gather, at = Gather(), files.nodes.numbering
        for name, one in self.sets.items():
            if one.nodes is not None:
                rows = at.rows(np.array(one.nodes))
                if name in named:
                    gather.faults.append(Fault(f"sets.{name}", f"'{self.nodes}' has a set '{name}' "
                                               "already: take another name"))
                elif (rows < 0).any():
                    gather.faults.append(Fault(
                        f"sets.{name}.nodes", f"'{self.nodes}' has no node "
                        f"{one.nodes[int(np.argmin(rows))]}"
                        + " with unknowns" * bool(files.notes)))
                elif len(np.unique(rows)) < len(rows):
                    gather.faults.append(Fault(f"sets.{name}.nodes", "a node is given twice"))
                else:
                    named[name] = np.sort(rows)
        gather.check()
        X = files.unknowns.X
        mesh = Mesh(X, np.zeros((0, X.shape[1] + 1), np.int64), named)
        try:
            return with_sets(mesh, {k: s for k, s in self.sets.items()
                                    if s.nodes is None})
        except InputError as error:
            raise error.under("sets") from None

    def _weights(self, nodes: FileNodes) -> dict[str, FloatArray]:
        """Set -> weights of its nodes where they are given, in the order of the set."""
        found = {}
        for name, one in self.sets.items():
            if one.nodes is not None and one.weights is not None:
                order = np.argsort(nodes.numbering.rows(np.array(one.nodes)))
                found[name] = np.array(one.weights)[order]
        return found

    def _loads(self, base: Path, written: str, files: _Files) -> NodalLoads:
        """Nodal forces, moments and heat of a file `written` in SI units: a table of node,
        direction and size (several entries of one are added), or a matrix with a row for each node.
        The caller names the option of an InputError, hence the empty key."""
        N, d = files.unknowns.X.shape
        # columns: direction of the table (1 to 3 forces, 4 to 6 moments, 11 heat), 0 unused; in the
        # plane the one moment is 6; r: number of moments
        r, values = 2 * d - 3, np.zeros((N, 12))
        if Path(written).suffix.lower() in TABLES:
            node, direction, size = read_table(base, written, 3, "").T
            rows = files.nodes.numbering.rows(whole(
                node, f"'{written}': the number of a node,"))
            allowed = [1, 2, 6, 11] if d == 2 else [1, 2, 3, 4, 5, 6, 11]
            if (rows < 0).any():
                raise InputError(f"'{self.nodes}' has no node {node[int(np.argmin(rows))]:.0f}")
            if not np.isin(direction, allowed).all():
                raise InputError(f"'{written}': directions are {allowed}, 11 of heat (got "
                                 f"{direction[~np.isin(direction, allowed)][0]:g})")
            np.add.at(values, (rows, direction.astype(np.int64)), size)
        else:
            found = read_matrix(base, written, "").matrix.toarray()
            if found.shape not in ((N, d), (N, d + r)):
                raise InputError(f"'{written}' is {found.shape[0]} x {found.shape[1]}: a row of "
                                 f"{d} or {d + r} numbers for each of {N} nodes is needed")
            values[:, 1 : d + 1] = found[:, :d]
            values[:, 7 - r : 7] = found[:, d:] if found.shape[1] > d else 0.0
        force = self.units.mass * self.units.length
        energy = force * self.units.length
        return NodalLoads(force * values[:, 1 : d + 1], energy * values[:, 7 - r : 7],
                          energy * values[:, 11])

    def _fixed(self, mesh: Mesh, u: Unknowns) -> IntArray | None:
        """Numbers of the unknowns u that the reference condition fixes at zero; None without an
        elastic field. InputError where a rigid motion is left. A clamp fixes the rotations of its
        nodes too (u.turning: there are some); other conditions (numbers d * node + component) fix
        displacements."""
        if ELASTIC.name not in self.selected_fields:
            return None
        if self.reference is None:
            return np.zeros(0, np.int64)
        if u.turning and self.reference.clamp is not None:
            nodes = find_set(mesh, self.reference.clamp, "reference.clamp")
            fixed = np.flatnonzero(np.isin(u.node, nodes))
        else:
            fixed = u.numbers(self.reference.fixed(mesh), "reference")
        # rigid motions (columns) that the fixed unknowns leave: those that are zero in their rows
        modes = u.rigid_modes / np.maximum(np.abs(u.rigid_modes).max(axis=0), 1e-300)
        free = modes.shape[1] - int(np.linalg.matrix_rank(modes[fixed], tol=1e-8))
        if free:
            raise InputError(f"the body still has {free} rigid motion{'s' * (free > 1)}: fix more "
                             "nodes", "reference")
        if len(fixed) == u.size and self.shapes is None:
            raise InputError(f"fixes all {u.size} unknowns, so that none is left to solve for",
                             "reference")
        return fixed

    def _constrained_basis(self, T: FloatArray, fixed: IntArray, u: Unknowns) -> FloatArray:
        """(k, j) basis of the coordinates of shapes T (n, k) that keep the unknowns `fixed` of u at
        zero, each of largest displacement 1. InputError if none is left, if they hold rigid motion,
        or if the shapes depend on each other linearly."""
        size = np.linalg.norm(T, axis=0)
        if not size.all():
            raise InputError(f"'{self.shapes}': shape {int(np.argmin(size)) + 1} is zero", "shapes")
        basis = null_space(T[fixed] / size, rcond=1e-9) / size[:, None] if len(fixed) else (
            np.eye(T.shape[1]))
        if not basis.size:
            raise InputError("no combination of the shapes is zero there: fix fewer nodes",
                             "reference")
        if not self._supported and self.reference is None and len(
                matrix_checks.rigid_coordinates(T, u)[0]):
            raise InputError("missing: the shapes hold rigid motion; give a reference condition, "
                             "such as {clamp: left} or {chord: [a, b]}", "reference")
        basis = basis / np.abs(T @ basis).max(axis=0)  # largest unknown 1 in each
        Z = T @ basis
        rank = int(np.linalg.matrix_rank(Z / np.linalg.norm(Z, axis=0), tol=1e-9))
        if rank < basis.shape[1]:
            raise InputError(f"'{self.shapes}': {basis.shape[1]} shapes are {rank} that are "
                             "linearly independent: leave out the others", "shapes")
        return np.asarray(basis)

    def _elasticity(
        self, files: _Files, fixed: IntArray, own: FloatArray | None
    ) -> Elasticity:
        """Elastic field from the matrices; fixed: unknowns of the reference condition; own: basis
        of shapes without rigid motion, if the body is given by shapes or was condensed. Damping:
        that of the options (Rayleigh C, modal) and of the file. Stress cannot be recovered without
        a mesh."""
        found, u = files.mechanical, files.unknowns
        if own is not None and files.shapes is not None:
            return self._of_shapes(files, files.shapes, own)
        K, N = found["stiffness"], len(u.X)
        C, modal = self.damping.of(K, found["mass"], fixed, u.d, self.frame == "floating")
        C = C + found["damping_matrix"] if "damping_matrix" in found else C
        return Elasticity(
            free=np.setdiff1d(np.arange(u.size), fixed), stiffness=K, damping=csr_array(C),
            modal=modal,
            coupling=csr_array((u.size, N)) if files.coupling is None else files.coupling,
            recoverable=False)

    def _condensed(
        self, files: _Files, fixed: IntArray, massive: IntArray
    ) -> tuple[_Files, FloatArray]:
        """Files with the free massless unknowns i condensed, u_i = -K_ii^-1 K_ib u_b, exactly as
        inertia does not act on them, and the basis of the unknowns `massive` alone.

        b: all others, fixed and massive ones; shapes (n, b): u by u_b; stiffness and damping are
        then (b, b), the mass stays that of all unknowns. basis (b, massive): 1 for its own unknown.
        InputError above `LARGEST` entries.
        """
        K = files.mechanical["stiffness"]
        massless = np.setdiff1d(np.arange(K.shape[0]), np.union1d(fixed, massive))
        kept = np.setdiff1d(np.arange(K.shape[0]), massless)
        if len(kept) * K.shape[0] > LARGEST:
            raise InputError(f"{len(massless)} of {K.shape[0]} unknowns have no mass, which are "
                             "too many to condense here: take a consistent mass matrix", "mass")
        shapes = np.zeros((K.shape[0], len(kept)))
        shapes[kept, np.arange(len(kept))] = 1.0
        factor = splu(K[massless][:, massless].tocsc())
        shapes[massless] = -factor.solve(K[massless][:, kept].toarray())
        reduced = {key: A if key == "mass" else csr_array(shapes.T @ (A @ shapes))
                   for key, A in files.mechanical.items()}
        basis = np.zeros((len(kept), len(massive)))
        basis[np.searchsorted(kept, massive), np.arange(len(massive))] = 1.0
        return replace(files, shapes=shapes, mechanical=reduced), basis

    def _of_shapes(self, files: _Files, T: FloatArray, basis: FloatArray) -> Elasticity:
        """Elastic field on shapes T (n, k): matrices reduced to the combinations `basis` (k, j) of
        these, which keep the reference condition. In `files` stiffness and damping are (k, k), the
        mass (n, n). Modal damping: of the free body, if the shapes T hold all its rigid motion, the
        frame floats and the option is not `held`, else of the combinations."""
        found, N, Z = files.mechanical, len(files.unknowns.X), T @ basis
        # coordinates of the basis: u = T basis c = Z c
        K, M = basis.T @ (found["stiffness"] @ basis), Z.T @ (found["mass"] @ Z)
        K, M = csr_array(0.5 * (K + K.T)), csr_array(0.5 * (M + M.T))
        no_fixed, d = np.zeros(0, np.int64), files.unknowns.d
        rigid = matrix_checks.rigid_coordinates(T, files.unknowns)[0]
        holds_rigid_motion = len(rigid) == d * (d + 1) // 2
        if self.damping.modes_of == "free" and not holds_rigid_motion:
            raise InputError("the shapes hold no rigid motion: their modes are `held`",
                             "damping.modes_of")
        if holds_rigid_motion and self.damping.modes_of != "held" and self.frame == "floating":
            whole_mass = csr_array(T.T @ (found["mass"] @ T))
            C, modal = self.damping.of(found["stiffness"], whole_mass, no_fixed, d, True)
            C, modal = basis.T @ (C @ basis), modal and replace(modal, L=basis.T @ modal.L)
        else:
            C, modal = self.damping.of(K, M, no_fixed, d, False)
        if "damping_matrix" in found:
            C = C + csr_array(basis.T @ (found["damping_matrix"] @ basis))
        return Elasticity(
            free=np.arange(basis.shape[1]), stiffness=K, damping=csr_array(C), modal=modal,
            coupling=csr_array((basis.shape[1], N)) if files.coupling is None else csr_array(
                Z.T @ files.coupling), recoverable=False)

    def _inertia(self, found: Mapping[str, Csr], u: Unknowns) -> MassProperties | None:
        return mass_properties(found["mass"], u, str(self.mass), not self._supported) if (
            "mass" in found) else None

    def _check(self, files: _Files, mesh: Mesh) -> None:
        """Raises InputError with the faults of all matrices. free: they are those of a body without
        supports. With shapes all but the mass are those of generalized coordinates (reduced)."""
        gather, free = Gather(), not self._supported
        for key, matrix in files.mechanical.items():
            if files.shapes is None or key == "mass":
                gather(key, matrix_checks.check_mechanical, key, getattr(self, key), matrix,
                       files.unknowns, free)
            else:
                gather(key, matrix_checks.check_reduced, getattr(self, key), matrix, files.shapes,
                       files.unknowns, free)
        for key, matrix in files.thermal.items():
            gather(key, matrix_checks.check_thermal, key, getattr(self, key), matrix)
        if files.coupling is not None and free:
            gather("coupling", matrix_checks.check_forces, str(self.coupling), files.coupling,
                   files.unknowns)
        gather.check()

    def _initial_temperature(self, X: FloatArray) -> FloatArray:
        T0 = self.initial_temperature
        if isinstance(T0, str):
            return evaluate_formula(T0, X, "initial_temperature")
        return np.full(len(X), self.reference_temperature if T0 is None else float(T0))

    def _notes(
        self, name: str, files: _Files, inertia: MassProperties | None
    ) -> Iterator[Note]:
        u, M = files.unknowns, files.mechanical.get("mass")
        yield from matrix_checks.size_notes(name, u.X, None if inertia is None else inertia.mass)
        if M is not None and inertia is not None and ELASTIC.name in self.selected_fields and (
                self.frame != "fixed"):
            yield from matrix_checks.moment_notes(name, u, M, inertia)


def _rows(labels: IntArray, wanted: IntArray, key: str, written: str) -> IntArray:
    """Rows of wanted labels (k, 2) among labels (n, 2)."""
    rows = Numbering(labels[:, 0] * 8 + labels[:, 1]).rows(wanted[:, 0] * 8 + wanted[:, 1])
    if (rows < 0).any():
        node, direction = wanted[int(np.argmin(rows))]
        raise InputError(f"'{written}' has the unknown {direction} of node {node}, which is not "
                         "in the file of unknowns", key)
    return rows
