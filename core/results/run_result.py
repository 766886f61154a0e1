"""Reader of a result: labelled arrays, and full-order fields evaluated for the requested steps."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.body import BodyPlugin, StressRecovery
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.poses import (
    KNOWN,
    PLANAR_POSE,
    SPINNING_POSE,
    points_in_space,
    vectors_in_space,
)
from sparsemor.core.protocols.prescribed_motion import Stage
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.files.replaceable_files import STORE
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.metadata import ProbeHeader, load_layout
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.presentation import Drawn, drawing, history_of, html_of
from sparsemor.core.results.result_variables import Derived, Field, one_function, read_stage
from sparsemor.core.results.stored_arrays import (
    ALL,
    HEADER,
    ResultArrays,
    StoredArrays,
    dataset,
    refuse_older,
)
from sparsemor.core.status import Status

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class RunResult(Drawn):
    """Stored result of one run, complete or not, at the state of the first reading. Pickled as its
    path.

    Blocks of unknowns are named `body.field`. Arrays over time have one row per stored step.
    Reduced runs store coefficients; full-order unknowns are computed on request, for the requested
    steps only. Cached arrays are read-only: copy before changing one. Raises `Damaged` for damaged
    or missing files.
    """

    def __init__(self, path: str | Path) -> None:
        """path: folder of the store. Raises InputError if there is no result in it.

        _path: folder, None for a result in memory (`of`); _arrays: arrays that were read, by name;
        _recoveries: body -> recovery of its stress;
        _folder: temporary folder that is removed with this result.
        """
        self._path: Path | None = Path(path).absolute()
        if not (self.path / HEADER).exists():
            refuse_older(self.path)
            kept = OutputDirectory(self.path).kept_note()
            raise InputError(f"there is no result in {path}{kept}")
        self._arrays: dict[str, NDArray[Any]] = {}
        self._recoveries: dict[str, StressRecovery] = {}
        self._folder: TemporaryFolder | None = None

    def held_in(self, folder: TemporaryFolder) -> "RunResult":
        """This result, with which the temporary folder is removed that it is stored in. If it is
        pickled, the folder stays until this process ends."""
        self._folder = folder
        return self

    @classmethod
    def of(cls, arrays: ResultArrays) -> "RunResult":
        """Result in memory, that of a kept model (plugins/kept_models/reduced_model.py)."""
        made = cls.__new__(cls)
        made._path, made._stored, made._arrays, made._recoveries = None, arrays, {}, {}
        made._folder = None
        return made

    @property
    def path(self) -> Path:
        """Folder of the store. Raises InputError for a result in memory."""
        if self._path is None:
            raise InputError("this result is in memory only: give the run a directory", "out")
        return self._path

    def __reduce__(self) -> tuple[Any, ...]:
        stored = self._stored
        if self._folder is not None:
            self._folder.keep_until_exit()
        return (RunResult, (self.path,)) if isinstance(stored, StoredArrays) else (
            RunResult.of, (stored,))

    def __repr__(self) -> str:
        return f"<RunResult {self.reducer}, {self.status.value}, {len(self.times)} stored steps>"

    def _repr_html_(self) -> str:
        """Main facts of the run as a table, for notebooks."""
        return html_of(self)

    @property
    def in_memory(self) -> bool:
        return self._path is None

    @cached_property
    def _stored(self) -> ResultArrays:
        return StoredArrays(self.path, self._folder)

    @cached_property
    def _data(self) -> ResultArrays:
        """Stored arrays, after a check that every committed chunk has its file."""
        self._stored.check()
        return self._stored

    @property
    def _attributes(self) -> dict[str, Any]:
        return self._stored.attributes

    @property
    def attributes(self) -> dict[str, Any]:
        """All attributes of the result (header, final status and summary), as plain data."""
        return dict(self._attributes)

    @property
    def summary(self) -> dict[str, Any]:
        """Summary written at the end of the run; empty if the run was killed."""
        return dict(self._attributes["summary"])

    @property
    def status(self) -> Status:
        return Status(self._attributes["status"])

    @property
    def scene(self) -> dict[str, Any]:
        return dict(self._attributes["scene"])

    @property
    def reducer(self) -> str:
        return str(self._attributes["reducer"])

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies whose mesh is stored."""
        return tuple(self._attributes["bodies"])

    @cached_property
    def layout(self) -> Layout:
        """Layout of the full-order unknowns."""
        return load_layout(self._attributes, "full_layout")

    @cached_property
    def solver_layout(self) -> Layout:
        return load_layout(self._attributes, "layout")

    @property
    def times(self) -> FloatArray:
        """(j,) stored times, s."""
        return self._array("time")

    @property
    def iterations(self) -> IntArray:
        """(j,) number of iterations of each stored step."""
        return self._array("iterations")

    @property
    def remaining_error(self) -> FloatArray:
        """(j,) estimated relative error that the iteration of each stored step leaves; 0 for a
        direct solution."""
        return self._array("remaining_error")

    @property
    def step_seconds(self) -> FloatArray:
        """(j,) computing time of each stored step, s."""
        return self._array("step_seconds")

    def steps_at(self, times: Sequence[float] | None) -> IntArray:
        """(j,) indices of the stored steps closest to `times` (s), unique and increasing; None: all
        steps.

        Raises InputError for times outside the run.
        """
        stored = self.times
        if len(stored) == 0:
            raise InputError("the run has no stored step yet")
        if times is None:
            return np.arange(len(stored))
        first, last = float(stored[0]), float(stored[-1])
        slack = 1e-9 * max(abs(first), abs(last))
        outside = [t for t in times if not first - slack <= t <= last + slack]
        if outside or not times:
            got = ", ".join(f"{t:g}" for t in outside) or "none"
            raise InputError(f"give times within the run, {first:g} to {last:g} s (got {got})")
        return np.unique([int(np.argmin(np.abs(stored - t))) for t in times])

    def reduced(self, name: str) -> bool:
        """True if a block is stored as coefficients of trial basis vectors (atoms)."""
        return f"{name}.coefficients" in self._data

    def block(self, name: str, steps: slice | IntArray = ALL) -> FloatArray:
        """(j, n) full-order unknowns of a block at the stored steps `steps`."""
        _require(name, [b.name for b in self.layout], "block", f"no block {name!r} in this result")
        if not self.reduced(name):
            return self._data.read(name, steps)
        if f"{name}.atoms" not in self._data:
            raise InputError(f"the full-order unknowns of {name} are not known: its model was "
                             "saved without fields; save it with fields=True (--fields)", "fields")
        c, atoms = self.coefficients(name, steps), self._array(f"{name}.atoms")
        return np.asarray(self._array(f"{name}.offset") + c @ atoms.T)

    def over_time(self, name: str, steps: slice) -> NDArray[Any] | None:
        """Entries of a stored array at some steps, None if there is no such array."""
        return self._data.read(name, steps) if name in self._data else None

    def coefficients(self, name: str, steps: slice | IntArray = ALL) -> FloatArray:
        """(j, k) coefficients of a reduced block at the stored steps `steps`."""
        return self._data.read(self._of_reduced(name, "coefficients"), steps)

    def atoms(self, name: str) -> FloatArray:
        """(n, k) trial basis vectors of a reduced block."""
        return self._array(self._of_reduced(name, "atoms"))

    def support(self, name: str) -> BoolArray:
        """(j, k) boolean: active basis vectors (atoms) of a reduced block at each stored step."""
        return self._array(self._of_reduced(name, "active"))

    @property
    def error_estimates(self) -> tuple[str, ...]:
        """Names of the blocks whose error was estimated during the run."""
        return tuple(self._attributes.get("estimates", ()))

    def error_estimate(self, name: str) -> FloatArray:
        """(j,) estimated norm of a block's error, in the unit of the block, at each stored step."""
        _require(name, self.error_estimates, "block", f"no estimate of the error of {name!r}")
        return self._array(f"error_estimate.{name}")

    def rows(self, name: str) -> IntArray:
        """Indices of the sampled rows (equations) of a block; empty for one without a sample."""
        key = f"{name}.rows"
        return self._array(key) if key in self._data else np.zeros(0, dtype=np.int64)

    @property
    def probes(self) -> tuple[str, ...]:
        return tuple(n.removeprefix("probe.") for n, e in self._data.arrays.items()
                     if "position" in e["attributes"])

    def probe(self, name: str) -> FloatArray:
        """(j, components) recorded values of a probe; `probe_header` names the components."""
        _require(name, self.probes, "probe", f"no probe {name!r} in this result")
        return self._array(f"probe.{name}")

    def probe_header(self, name: str) -> ProbeHeader:
        """Position, and names and units of the recorded components, of a probe."""
        self.probe(name)  # says which there are
        a = self._data.arrays[f"probe.{name}"]["attributes"]
        return ProbeHeader(name, a["body"], tuple(a["position"]), tuple(a["components"]),
                     tuple(a["units"].split(", ")))

    def points(self, body: str) -> FloatArray:
        """(N, d) reference positions in the body frame, m."""
        return self._array(self._of_body(body, "points"))

    def cells(self, body: str) -> IntArray:
        """(E, 3, 4, 6 or 10) node numbers of each element: linear or quadratic triangles or
        tetrahedra, corners first."""
        return self._array(self._of_body(body, "cells"))

    def nodal_displacement(self, body: str, step: int) -> FloatArray:
        """(N, d) nodal displacements in the body frame, m, at stored step `step`."""
        u = self._at_nodes(body, "displacement", self.points(body).shape)
        self._fill(u, body, Quantity.DISPLACEMENT, step)
        return u

    def nodal_temperature(self, body: str, step: int) -> FloatArray:
        """(N,) nodal temperatures, K, at stored step `step`."""
        temperature = self._at_nodes(body, "temperature", self.points(body).shape[:1])
        if f"{body}.given" in self._data:  # an older result knows those of the start alone
            old = f"{body}.given_shapes" not in self._data
            shapes = one_function(self._array(f"{body}.given_of")) if old else (
                self._array(f"{body}.given_shapes"))
            temperature += shapes @ self._data.read(f"{body}.given", self._only(step))[0]
        self._fill(temperature, body, Quantity.TEMPERATURE, step)
        return temperature

    def has(self, body: str, field: Field) -> bool:
        """True if a body has the field at its nodes: displacement, temperature, or the stress and
        strain of an elastic body with properties that do not depend on temperature."""
        if isinstance(field, Derived):
            return f"{body}.stress_constants" in self._data
        return self.layout.of(body, field) is not None

    def strain(self, body: str, step: int) -> FloatArray:
        """(P, 3, 3) nodal strain in body axes at stored step `step`, with the thermal strain;
        averaged over the cells of one material at a node (`stress_mesh`). Of a body with nonlinear
        strains the Green-Lagrange strain, in the axes of the undeformed body."""
        return self._recovery(body).strain(
            self.nodal_displacement(body, step), self._heating(body, step))

    def stress(self, body: str, step: int) -> FloatArray:
        """(P, 3, 3) nodal Cauchy stress in body axes, Pa, at stored step `step`, with the thermal
        stress; averaged over the cells of one material at a node (`stress_mesh`)."""
        return self._recovery(body).stress(
            self.nodal_displacement(body, step), self._heating(body, step))

    def von_mises(self, body: str, step: int) -> FloatArray:
        """(P,) von Mises stress of the nodal stress, Pa, at stored step `step`."""
        return self._recovery(body).von_mises(
            self.nodal_displacement(body, step), self._heating(body, step))

    def equivalent_strain(self, body: str, step: int) -> FloatArray:
        """(P,) equivalent strain sqrt(2/3 e : e), e the deviator of the nodal strain."""
        return self._recovery(body).equivalent_strain(
            self.nodal_displacement(body, step), self._heating(body, step))

    def stress_mesh(self, body: str) -> tuple[IntArray, IntArray]:
        """Nodes (P,) of the values of stress and strain, and their numbers (E, q) in each cell.

        A node between materials has a value in each of them. The first N values are those of all
        nodes in one of their materials; with a single material there are no others.
        """
        made = self._recovery(body)
        return made.nodes, made.own

    def _heating(self, body: str, step: int) -> FloatArray:
        """(N,) temperatures above the stress-free ones, K."""
        self._recovery(body)  # says where there is no stress
        free: FloatArray = self._array(f"{body}.stress_free_temperature")
        return self.nodal_temperature(body, step) - free

    def _recovery(self, body: str) -> StressRecovery:
        """Recovery of stress from displacements and temperatures, as the body's plugin defines it,
        kept for further steps."""
        if not self.has(body, Derived.STRESS):
            raise InputError(
                f"{body} has no stress in this result: its displacements were not solved for, its "
                "material depends on temperature, or an older version stored it", key="body")
        if body not in self._recoveries:
            # the law of the stress is that of the body's plugin; the result has its constants
            use = self.scene["bodies"][body]["use"]
            plugin = cast("type[BodyPlugin]", Registry().get("body", use))
            made = plugin.stress_recovery(
                self.points(body), self.cells(body), self._array(f"{body}.stress_constants"),
                self._array(f"{body}.stress_region"),
                "strains" in self._data.arrays[f"{body}.stress_constants"]["attributes"])
            if made is None:
                raise InputError(f"the plugin {use} recovers no stress of {body}", key="body")
            self._recoveries[body] = made
        return self._recoveries[body]

    def positions(self, body: str, step: int, magnify: float = 1.0) -> FloatArray:
        """(N, d) global node positions R + A (X + magnify u) of a body, m, at stored step
        `step`."""
        u = self.nodal_displacement(body, step)
        return self.in_space(body, step, self.points(body) + magnify * u)

    def in_space(self, body: str, step: int, z: FloatArray) -> FloatArray:
        """(j, d) global positions R + A z, m, of points z (j, d) given in the body frame."""
        return points_in_space(self._poses(body, step, len(z)), z)

    def turned(self, body: str, step: int, vectors: FloatArray) -> FloatArray:
        """(j, d) global components A w of vectors w (j, d) given in the body frame, such as
        displacements."""
        return vectors_in_space(self._poses(body, step, len(vectors)), vectors)

    def pose(self, body: str, step: int) -> FloatArray:
        """Rigid coordinates of a body's frame at stored step `step`: position (m) and rotation.

        (3,) in the plane: position and angle (rad); in space (4,) position and angle about a fixed
        axis, or (7,) position and quaternion. Zeros, of the length that matches the mesh, for a
        fixed frame in a result of an older version, which does not contain it.
        """
        frame = self.layout.of(body, Quantity.POSE)
        if frame is not None:
            return np.asarray(self.block(frame.name, self._only(step))[0])
        stage = self.stage()
        if stage is not None and body in stage.frames:
            return stage.frames[body].at(float(self.times[self._only(step)][0]))[0]
        if f"{body}.pose" in self._data:
            return self._array(f"{body}.pose")
        points = f"{body}.points"
        solid = points in self._data and self._data.shape(points)[1] == 3
        return np.zeros(SPINNING_POSE if solid else PLANAR_POSE)

    def _poses(self, body: str, step: int, count: int) -> FloatArray:
        """(count, b) the pose of a body at a stored step, once for each of `count` points."""
        pose = self.pose(body, step)
        if pose.size not in KNOWN:
            raise InputError(
                f"{body} has {pose.size} rigid coordinates: only frames (Rx, Ry, theta), "
                "(R, angle) and (R, quaternion) can be placed", key="body")
        return np.broadcast_to(pose, (count, pose.size))

    def stage(self) -> Stage | None:
        """Motion, joint reactions and contact resultants of the rigid pre-simulation that the run
        followed, at the times of the pre-simulation; None without one."""
        return self._stage

    @cached_property
    def _stage(self) -> Stage | None:
        names = self._attributes.get("stage")
        return read_stage(names, self._data) if names else None

    def contacts(self) -> Mapping[str, Mapping[str, FloatArray]]:
        """Contact -> quantity -> (T,) history: "time", s; "normal" and "friction", N, magnitudes of
        the resultants; "power", W; "length", m, or in space "area", m2, of the contact region;
        "pressure", Pa, its maximum.

        Times: those of the rigid pre-simulation if there was one, otherwise the stored steps.
        Contacts whose resultants the run did not compute are absent.
        """
        stage = self.stage()
        if stage is not None:
            return {name: {"time": stage.times, **kept} for name, kept in stage.contacts.items()}
        return {name: {"time": self.times}
                | {what: self._array(f"contact.{name}.{what}") for what in kept}
                for name, kept in self._attributes.get("contacts", {}).items()}

    def joint_forces(self) -> Mapping[str, Mapping[tuple[str, str], FloatArray]]:
        """Joint -> (name, unit) -> (j,) values, N or N m, at the stored steps: multipliers, with
        the sign of the left-hand side of the equations of motion, and forces of force elements."""
        found: dict[str, dict[tuple[str, str], FloatArray]] = {}
        if (stage := self.stage()) is not None:
            for name, of_unit in stage.components.items():
                kept = Table(stage.times, stage.reactions[name]).along(self.times)
                found[name] = dict(zip(of_unit, kept.T, strict=True))
        for b in self.layout:  # multipliers are unknowns of order 0, with names of components
            given = self._data.arrays[b.name]["attributes"] if b.kind.order == 0 else {}
            if "components" in given:
                of_unit = tuple(zip(given["components"], given["units"].split(", "), strict=True))
                found[b.owner] = dict(zip(of_unit, self.block(b.name).T, strict=True))
        for name, force in self.element_forces.items():
            found.setdefault(name, {})[force] = self._array(f"force.{name}")
        return found

    @property
    def element_forces(self) -> dict[str, tuple[str, str]]:
        """Force element -> name and unit of its force."""
        return {n: (what, si) for n, (what, si) in self._attributes.get("forces", {}).items()}

    def to_xarray(self) -> "xr.Dataset":
        """All stored arrays as a lazily loaded xarray dataset with dimension names and units."""
        return dataset(self._data)

    def history(self, name: str) -> "xr.DataArray":
        """Probe, block, joint or another array over time, full-order and with the names of its
        components: `history("crank.rigid").sel(unknown="angle")`."""
        return history_of(self, name)

    def to_dataframe(self, name: str) -> "pd.DataFrame":
        """`history(name)` as a pandas table: times (s) as index, one column for each component."""
        found = self.history(name)
        return found.to_dataframe() if found.ndim == 1 else found.to_pandas()

    def animate(self, field: str = "displacement", **options: Any) -> Any:
        """Animation, which notebooks show; options: frames, at, magnify of `sparsemor.animate`."""
        return drawing().animation_of(self, field, **options)

    def _at_nodes(self, body: str, what: str, shape: tuple[int, ...]) -> FloatArray:
        """Nodal values of those unknowns that are not solved for, 0 of the others; a new array."""
        key = f"{body}.eliminated_{what}"
        return self._array(key).copy() if key in self._data else np.zeros(shape)

    def _fill(self, values: FloatArray, body: str, quantity: Quantity, step: int) -> None:
        """Writes the unknowns of a body at a stored step into its nodal values, in place."""
        block = self.layout.of(body, quantity)
        if block is not None:
            dofs = self._array(f"{block.name}.places")
            values.reshape(-1)[dofs] = self.block(block.name, self._only(step))[0]

    def _only(self, step: int) -> slice:
        """Slice of one stored step, counted from the end if negative. Raises IndexError."""
        count = self._data.shape("time")[0]
        if not -count <= step < count:
            raise IndexError(f"step {step} of a result with {count} stored steps")
        first = step % count
        return slice(first, first + 1)

    def _of_reduced(self, name: str, what: str) -> str:
        """Name of an array of a reduced block. Raises InputError for another block."""
        if not self.reduced(name):
            raise InputError(f"{name} is not reduced in this run: it has no {what}", key="block")
        return f"{name}.{what}"

    def _of_body(self, body: str, what: str) -> str:
        """Name of an array of a body. Raises InputError for another one."""
        _require(body, self.bodies, "body", f"no body {body!r} with a stored shape")
        return f"{body}.{what}"

    def _array(self, name: str) -> NDArray[Any]:
        """A stored array, read once; read-only."""
        if name not in self._arrays:
            self._arrays[name] = self._data.read(name)
            self._arrays[name].flags.writeable = False
        return self._arrays[name]


def _require(name: str, known: Sequence[str], key: str, fault: str) -> None:
    """Raises InputError with this fault for a name that is not among the known ones."""
    if name not in known:
        raise InputError(f"{fault}; it has {', '.join(known) or 'none'}", key)


def open_result(path: str | Path) -> RunResult:
    """Result stored at `path` or in `path/result`. Raises InputError if there is none."""
    inside = Path(path) / STORE
    return RunResult(inside if (inside / HEADER).exists() else path)
