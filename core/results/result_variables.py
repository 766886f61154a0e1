"""Definition of the arrays of a result: names, dimensions and units, and the values of those that
do not depend on time; fields of bodies, stress and strain among them, which follow from them."""

import uuid
from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.body import BodyShape
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import COORDINATES
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.results.metadata import (
    CONTACT_UNITS,
    POSE_UNITS,
    REACTION_UNITS,
    RunHeader,
)
from sparsemor.core.results.stored_arrays import FORMAT, TIME, ResultArrays, array_entry, as_stored
from sparsemor.core.status import Status

_CHUNK_BYTES = 2**22
CHUNK_STEPS = 1024
Fixed = Mapping[str, tuple[dict[str, Any], NDArray[Any]]]
"""Name -> entry (`array_entry`) and values of each array that does not depend on time."""
STAGE_TIME = "stage.time"
"""Dimension, and array, of the times of a rigid pre-simulation."""


class Derived(Enum):
    """Field that is computed from unknowns: von Mises `stress`, Pa, and equivalent `strain`."""

    STRESS = "stress"
    STRAIN = "strain"


Field: TypeAlias = Quantity | Derived
FIELDS: dict[str, Field] = {
    f.value: f for f in (Quantity.DISPLACEMENT, Quantity.TEMPERATURE, *Derived)}
"""Name of a field in files, options and charts -> field."""


def started_attributes(header: RunHeader) -> dict[str, Any]:
    """Attributes of a result at the start of its run, which has a new identifier."""
    return header.attributes() | {"format": FORMAT, "run": uuid.uuid4().hex,
                                  "status": Status.INTERRUPTED.value, "summary": {}}


def steps_per_chunk(header: RunHeader) -> int:
    """Number of steps in a file of steps: about 4 MB for the largest block, 8 to 1024 steps."""
    widest = max((b.size for b in header.layout), default=1)
    return int(np.clip(_CHUNK_BYTES // (8 * widest), 8, CHUNK_STEPS))


def time_arrays(header: RunHeader) -> dict[str, dict[str, Any]]:
    """Name -> entry (`array_entry`) of the arrays that grow with time: of steps, blocks of unknowns
    (of reduced ones coefficients and active atoms), probes, prescribed temperatures, error
    estimates, contacts and force elements. Raises ValueError for two arrays of one name."""
    made: dict[str, dict[str, Any]] = {}

    def add(name: str, dtype: str, inner: tuple[tuple[str, int], ...], **attributes: Any) -> None:
        """Adds an array; inner: names and sizes of its dimensions after time."""
        if name in made:
            raise ValueError(f"two arrays of the result are named {name!r}: rename the probe")
        sizes = [size for _, size in inner]
        made[name] = array_entry([0, *sizes], dtype, [TIME, *(d for d, _ in inner)], attributes)

    add(TIME, "float64", (), units="s", long_name="time")
    add("iterations", "int64", (), units="1", long_name="iterations of the step")
    add("remaining_error", "float64", (), units="1",
        long_name="estimated relative error that the iteration of the step leaves")
    add("step_seconds", "float64", (), units="s", long_name="computing time of the step")
    for b in header.layout:
        if b.name in header.dictionaries:
            inner = ((f"{b.name}.atom", b.size),)
            add(f"{b.name}.coefficients", "float64", inner, units=b.kind.unit)
            add(f"{b.name}.active", "bool", inner, long_name="atom is in use")
        elif b.name in header.multipliers:
            names, units = zip(*header.multipliers[b.name], strict=True)
            add(b.name, "float64", ((f"{b.name}.unknown", b.size),), units=", ".join(units),
                components=list(names))
        else:
            named: Any = {"components": list(COORDINATES[b.size])} if (
                b.kind.quantity is Quantity.POSE and b.size in COORDINATES) else {}
            add(b.name, "float64", ((f"{b.name}.unknown", b.size),), units=b.kind.unit, **named)
    for p in header.probes:
        inner = ((f"probe.{p.name}.component", len(p.components)),)
        add(f"probe.{p.name}", "float64", inner, units=", ".join(p.units), body=p.body,
            components=list(p.components), position=[float(v) for v in p.position])
    for body, shape in header.bodies.items():
        if shape.given:
            add(f"{body}.given", "float64", ((f"{body}.function", len(shape.given)),), units="K",
                long_name="prescribed temperatures")
    for name in header.estimates:
        add(f"error_estimate.{name}", "float64", (), units=header.full_layout.block(name).kind.unit,
            long_name="norm of the estimated error")
    for name, kept in header.contacts.items():
        for what in kept:
            add(f"contact.{name}.{what}", "float64", (), units=CONTACT_UNITS.get(what, ""))
    for name, (what, si) in header.forces.items():
        add(f"force.{name}", "float64", (), units=si, long_name=what)
    return made


def fixed_arrays(header: RunHeader) -> Fixed:
    """Arrays of a result that do not depend on time, without copies."""
    found: dict[str, tuple[dict[str, Any], NDArray[Any]]] = {}
    for name, dimensions, attributes, given in _fixed(header):
        if name in found:
            raise ValueError(f"two arrays of the result are named {name!r}: rename the probe")
        values = as_stored(given)
        found[name] = array_entry(values.shape, str(values.dtype), dimensions, attributes), values
    return found


_Array = tuple[str, tuple[str, ...], dict[str, Any], NDArray[Any]]
"""Name, dimensions, attributes and values of an array."""


def _fixed(header: RunHeader) -> Iterator[_Array]:
    """Arrays of a result that do not depend on time: dictionaries, sampled rows, the stage,
    bodies; each as its name, dimensions, attributes and values."""
    for name, d in header.dictionaries.items():
        if d.atoms.shape[1] and not len(d.atoms):  # of a model that was saved without fields
            continue
        block, unknown = header.full_layout.block(name), f"{name}.unknown"
        _expect(f"atoms of {name}", d.atoms.shape, (block.size, header.layout.block(name).size))
        _expect(f"offset of {name}", d.offset.shape, (block.size,))
        yield f"{name}.atoms", (unknown, f"{name}.atom"), {"units": "1"}, d.atoms
        yield f"{name}.offset", (unknown,), {"units": block.kind.unit}, d.offset
    for name, rows in header.rows.items():
        yield f"{name}.rows", (f"{name}.row",), {"long_name": "sampled rows"}, rows
    if header.stage is not None:
        yield from _stage_arrays(header.stage)
    for name, shape in header.bodies.items():
        yield from _body_arrays(header, name, shape)


def _body_arrays(header: RunHeader, body: str, shape: BodyShape) -> Iterator[_Array]:
    """Arrays of a body, each with its dimensions and unit: mesh, numbers of its unknowns,
    prescribed values, constants of its stress. Raises ValueError for shapes that do not fit the
    layout or each other."""
    node, axis = f"{body}.node", f"{body}.axis"
    yield f"{body}.points", (node, axis), {"units": "m"}, shape.points
    yield f"{body}.cells", (f"{body}.cell", f"{body}.corner"), {}, shape.cells
    for quantity, numbers in ((Quantity.DISPLACEMENT, shape.elastic_dofs),
                              (Quantity.TEMPERATURE, shape.thermal_nodes)):
        block = header.full_layout.of(body, quantity)
        if (numbers is None) is not (block is None):
            raise ValueError(f"{body}: the layout and the body's shape disagree on its "
                             f"{quantity.value}")
        if numbers is not None and block is not None:
            _expect(f"unknowns of {block.name}", numbers.shape, (block.size,))
            yield f"{block.name}.places", (f"{block.name}.unknown",), {}, numbers
    if shape.eliminated_displacement is not None:
        _expect(f"{body}: eliminated_displacement", shape.eliminated_displacement.shape,
                shape.points.shape)
        yield (f"{body}.eliminated_displacement", (node, axis), {"units": "m"},
               shape.eliminated_displacement)
    if shape.eliminated_temperature is not None:
        _expect(f"{body}: eliminated_temperature", shape.eliminated_temperature.shape,
                shape.points.shape[:1])
        yield (f"{body}.eliminated_temperature", (node,), {"units": "K"},
               shape.eliminated_temperature)
    if shape.given:
        yield (f"{body}.given_shapes", (node, f"{body}.function"),
               {"long_name": "shares in the prescribed temperature of the node"},
               shape.given_shapes)
    if shape.stress is not None:
        s, cells = shape.stress, shape.cells.shape[:1]
        _expect(f"{body}: material of each cell", s.region.shape, cells)
        yield (f"{body}.stress_constants", (f"{body}.material", f"{body}.constant"),
               {"units": "Pa, Pa, Pa/K, Pa, Pa/K",
                "long_name": "lam, mu, beta; lam, beta across the plane",
                **({"strains": "nonlinear"} if s.nonlinear else {})}, s.constants)
        yield (f"{body}.stress_region", (f"{body}.cell",),
               {"long_name": "material of the cell"}, s.region)
        yield (f"{body}.stress_free_temperature", (node,), {"units": "K"}, s.free)
    if shape.pose is not None:
        yield (f"{body}.pose", (f"{body}.coordinate",),
               {"units": POSE_UNITS, "long_name": "frame at the start"}, shape.pose)


def _stage_arrays(stage: Stage) -> Iterator[_Array]:
    """Arrays of the rigid-body pre-simulation: frames, joint reactions, resultants of contacts;
    each as its name, dimensions, attributes and values."""
    yield STAGE_TIME, (STAGE_TIME,), {"units": "s"}, stage.times
    for name, h in stage.frames.items():
        motion = np.stack([h.pose, h.rate, h.acceleration], axis=1)
        yield (f"stage.{name}.frame", (STAGE_TIME, "stage.derivative", f"stage.{name}.coordinate"),
               {"units": POSE_UNITS, "long_name": "pose, rate and acceleration"}, motion)
    for name, forces in stage.reactions.items():
        yield (f"stage.{name}.reaction", (STAGE_TIME, f"stage.{name}.multiplier"),
               {"units": REACTION_UNITS}, forces)
    for name, histories in stage.contacts.items():
        for what, values in histories.items():
            units = {"units": CONTACT_UNITS.get(what, "")}
            yield f"stage.{name}.{what}", (STAGE_TIME,), units, values


def read_stage(names: Mapping[str, Any], data: ResultArrays) -> Stage:
    """Rigid pre-simulation of a result. names: its attribute `stage` (`RunHeader`); data: the
    arrays."""

    def read(name: str) -> FloatArray:
        return data.read(f"stage.{name}")

    times = read("time")
    # (T, 3, n): pose, rate and acceleration
    frames = {n: FrameHistory(times, *read(f"{n}.frame").transpose(1, 0, 2))
              for n in names["frames"]}
    contacts = {n: {what: read(f"{n}.{what}") for what in histories}
                for n, histories in names["contacts"].items()}
    components = {n: tuple((what, unit) for what, unit in kept)
                  for n, kept in names.get("components", {}).items()}
    return Stage(times, frames, moves=frozenset(names["moves"]),
                 reactions={n: read(f"{n}.reaction") for n in names["reactions"]},
                 contacts=contacts, components=components)


def one_function(which: IntArray) -> FloatArray:
    """`given_shapes` (N, functions) of an older result, with the number of the one function of each
    node (N,), -1 for none."""
    return np.asarray(which[:, None] == np.arange(which.max() + 1), dtype=np.float64)


def _expect(what: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Raises ValueError for an array, called `what`, of another shape."""
    if shape != expected:
        raise ValueError(f"{what}: shape {shape}, expected {expected}")
