"""Reader of a result: labelled data, and full fields evaluated for the requested steps."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.poses import (
    KNOWN,
    PLANAR_POSE,
    SPINNING_POSE,
    points_in_space,
    vectors_in_space,
)
from sparsemor.core.protocols.prescribed_motion import Stage
from sparsemor.core.results.metadata import Probe, load_layout
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.stage_arrays import read_stage
from sparsemor.core.results.stored_arrays import ALL, StoredArrays
from sparsemor.core.results.zarr_files import GROUP_FILE
from sparsemor.core.status import Status

if TYPE_CHECKING:
    import xarray as xr


class RunResult:
    """One run, finished or not, as it stood when first read. Pickles as its path.

    Blocks are named `body.field`. Arrays over time have one row a stored step. Reduced runs
    hold coefficients; full unknowns are computed on request, for the requested steps only. Whole
    arrays are read-only: copy one to change it. Raises `Damaged` for damaged or missing files.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()
        if not (self.path / GROUP_FILE).exists():
            kept = OutputDirectory(self.path).kept_note()
            raise InputError(f"there is no result in {path}{kept}")
        self._arrays: dict[str, NDArray[Any]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return RunResult, (self.path,)

    def __repr__(self) -> str:
        return f"<RunResult {self.reducer}, {self.status.value}, {len(self.times)} stored steps>"

    @cached_property
    def _stored(self) -> StoredArrays:
        return StoredArrays(self.path)

    @cached_property
    def _data(self) -> StoredArrays:
        """The arrays, once every committed chunk has its file."""
        self._stored.check()
        return self._stored

    @property
    def _attributes(self) -> dict[str, Any]:
        return self._stored.attributes

    @property
    def attributes(self) -> dict[str, Any]:
        """Everything the header and the end of the run wrote, as plain data."""
        return dict(self._attributes)

    @property
    def summary(self) -> dict[str, Any]:
        """Summary that the run wrote at its end; empty when it was killed."""
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
        """Bodies whose shape is stored."""
        return tuple(self._attributes["bodies"])

    @cached_property
    def layout(self) -> Layout:
        """The full-order unknowns."""
        return self._load_layout("full_layout")

    @cached_property
    def solver_layout(self) -> Layout:
        return self._load_layout("layout")

    def _load_layout(self, which: str) -> Layout:
        return load_layout(self._attributes, which, self._stored.metadata)

    @property
    def times(self) -> FloatArray:
        """(j,) s."""
        return self._array("time")

    @property
    def iterations(self) -> IntArray:
        """(j,) iterations of each stored step."""
        return self._array("iterations")

    @property
    def step_seconds(self) -> FloatArray:
        """(j,) computing time of each stored step, s."""
        return self._array("step_seconds")

    def steps_at(self, times: Sequence[float] | None) -> IntArray:
        """(j,) the stored steps next to `times` (s), each once, increasing; None: all of them.

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
        """True if a block is held as coefficients of a dictionary."""
        return f"{name}.atoms" in self._data

    def block(self, name: str, steps: slice | IntArray = ALL) -> FloatArray:
        """(j, n) full-order unknowns of a block at the stored steps `steps`."""
        if name not in self.layout:
            have = ", ".join(b.name for b in self.layout)
            raise InputError(f"no block {name!r} in this result; it has {have}", key="block")
        if not self.reduced(name):
            return self._data.read(name, steps)
        c, atoms = self.coefficients(name, steps), self._array(f"{name}.atoms")
        return np.asarray(self._array(f"{name}.offset") + c @ atoms.T)

    def coefficients(self, name: str, steps: slice | IntArray = ALL) -> FloatArray:
        """(j, k) coefficients of a reduced block at the stored steps `steps`."""
        return self._data.read(self._of_reduced(name, "coefficients"), steps)

    def support(self, name: str) -> BoolArray:
        """(j, k) which atoms of a reduced block were in use."""
        return self._array(self._of_reduced(name, "active"))

    def rows(self, name: str) -> IntArray:
        """The sampled rows of a block; empty when it was not sampled."""
        key = f"{name}.rows"
        return self._array(key) if key in self._data else np.zeros(0, dtype=np.int64)

    @property
    def probes(self) -> tuple[str, ...]:
        arrays = {n: self._data.attributes_of(n) for n in self._data.names}
        return tuple(n.removeprefix("probe.") for n, a in arrays.items() if "position" in a)

    def probe(self, name: str) -> FloatArray:
        """(j, components) of a probe; their names stand in its attributes in `to_xarray`."""
        if name not in self.probes:
            have = ", ".join(self.probes) or "none"
            raise InputError(f"no probe {name!r} in this result; it has {have}", key="probe")
        return self._array(f"probe.{name}")

    def probe_header(self, name: str) -> Probe:
        """Position and columns of a probe."""
        self.probe(name)  # says which there are
        a = self._data.attributes_of(f"probe.{name}")
        return Probe(name, a["body"], tuple(a["position"]), tuple(a["components"]),
                     tuple(a["units"].split(", ")))

    def points(self, body: str) -> FloatArray:
        """(N, d) reference positions in the body frame, m."""
        return self._array(self._of_body(body, "points"))

    def cells(self, body: str) -> IntArray:
        """(E, d + 1) point numbers."""
        return self._array(self._of_body(body, "cells"))

    def nodal_displacement(self, body: str, step: int) -> FloatArray:
        """(N, d) displacements in the body frame, m; `step` counts stored steps."""
        u = self._at_nodes(body, "displacement", self.points(body).shape)
        self._fill(u, body, Quantity.DISPLACEMENT, step)
        return u

    def nodal_temperature(self, body: str, step: int) -> FloatArray:
        """(N,) temperatures, K."""
        temperature = self._at_nodes(body, "temperature", self.points(body).shape[:1])
        if f"{body}.given" in self._data:  # an older result knows those of the start alone
            which = self._array(f"{body}.given_of")
            values = self._data.read(f"{body}.given", self._only(step))[0]
            temperature[which >= 0] = values[which[which >= 0]]
        self._fill(temperature, body, Quantity.TEMPERATURE, step)
        return temperature

    def positions(self, body: str, step: int, magnify: float = 1.0) -> FloatArray:
        """(N, d) global positions R + A (X + magnify u) of a body, m."""
        u = self.nodal_displacement(body, step)
        return self.in_space(body, step, self.points(body) + magnify * u)

    def in_space(self, body: str, step: int, z: FloatArray) -> FloatArray:
        """(j, d) global positions R + A z, m, of points z (j, d) in body axes."""
        return points_in_space(self._poses(body, step, len(z)), z)

    def turned(self, body: str, step: int, vectors: FloatArray) -> FloatArray:
        """(j, d) A w of vectors w (j, d) in body axes, such as displacements."""
        return vectors_in_space(self._poses(body, step, len(vectors)), vectors)

    def pose(self, body: str, step: int) -> FloatArray:
        """(3,) position of a body's frame (m) and angle (rad), in space (4,) position and angle or
        (7,) position and quaternion; of the length that suits its mesh, and zero, where an older
        result does not tell where a fixed frame is."""
        frame = self.layout.of(body, Quantity.POSE)
        if frame is not None:
            return np.asarray(self.block(frame.name, self._only(step))[0])
        stage = self.stage()
        if stage is not None and body in stage.frames:
            return stage.frames[body].at(float(self.times[self._only(step)][0]))[0]
        if f"{body}.pose" in self._data:
            return self._array(f"{body}.pose")
        return np.zeros(SPINNING_POSE if self._in_space(body) else PLANAR_POSE)

    def _poses(self, body: str, step: int, count: int) -> FloatArray:
        pose = self.pose(body, step)
        if pose.size not in KNOWN:
            raise InputError(
                f"{body} has {pose.size} rigid coordinates: only frames (Rx, Ry, theta), "
                "(R, angle) and (R, quaternion) can be placed", key="body")
        return np.broadcast_to(pose, (count, pose.size))

    def _in_space(self, body: str) -> bool:
        return f"{body}.points" in self._data and self._data.shape(f"{body}.points")[1] == 3

    def stage(self) -> Stage | None:
        """Motion, joint forces and contact histories of the rigid stage that the run followed, at
        the stage's own times; None for a scene without one."""
        return self._stage

    @cached_property
    def _stage(self) -> Stage | None:
        names = self._attributes.get("stage")
        return read_stage(names, self._data) if names else None

    def contacts(self) -> Mapping[str, Mapping[str, FloatArray]]:
        """Contact -> name -> (T,): "time" s; "normal", "friction" N, the sizes of the resultants;
        "power" W; "length" m, in space "area" m2, in contact; "pressure" Pa, the largest.

        At the times of the rigid stage, where there was one, else at the stored steps; without
        contacts that the run did not evaluate as a whole.
        """
        stage = self.stage()
        if stage is not None:
            return {name: {"time": stage.times, **kept} for name, kept in stage.contacts.items()}
        return {name: {"time": self.times}
                | {what: self._array(f"contact.{name}.{what}") for what in kept}
                for name, kept in self._attributes.get("contacts", {}).items()}

    def to_xarray(self) -> "xr.Dataset":
        """All that is stored, lazily, with dimension names and units."""
        return self._data.dataset()

    def _at_nodes(self, body: str, what: str, shape: tuple[int, ...]) -> FloatArray:
        key = f"{body}.eliminated_{what}"
        return self._array(key).copy() if key in self._data else np.zeros(shape)

    def _fill(self, values: FloatArray, body: str, quantity: Quantity, step: int) -> None:
        block = self.layout.of(body, quantity)
        if block is not None:
            dofs = self._array(f"{block.name}.places")
            values.reshape(-1)[dofs] = self.block(block.name, self._only(step))[0]

    def _only(self, step: int) -> slice:
        count = self._data.shape("time")[0]
        if not -count <= step < count:
            raise IndexError(f"step {step} of a result with {count} stored steps")
        first = step % count
        return slice(first, first + 1)

    def _of_reduced(self, name: str, what: str) -> str:
        if not self.reduced(name):
            raise InputError(f"{name} is not reduced in this run: it has no {what}", key="block")
        return f"{name}.{what}"

    def _of_body(self, body: str, what: str) -> str:
        if body not in self.bodies:
            have = ", ".join(self.bodies) or "none"
            raise InputError(f"no body {body!r} with a stored shape; there are {have}", key="body")
        return f"{body}.{what}"

    def _array(self, name: str) -> NDArray[Any]:
        if name not in self._arrays:
            self._arrays[name] = self._data.read(name)
            self._arrays[name].flags.writeable = False
        return self._arrays[name]


def open_result(path: str | Path) -> RunResult:
    """The run stored at `path`, or in `path/result.zarr`. Raises InputError if there is none."""
    inside = Path(path) / "result.zarr"
    return RunResult(inside if (inside / GROUP_FILE).exists() else path)
