"""Arrays of a rigid pre-simulation (motion, joint reactions, contact resultants) in a result:
writing and reading."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.results.metadata import CONTACT_UNITS, POSE_UNITS, REACTION_UNITS
from sparsemor.core.results.stored_arrays import ResultArrays

TIME = "stage.time"


def stage_attributes(stage: Stage | None) -> dict[str, Any] | None:
    """Names of the stored quantities of a rigid pre-simulation, as plain data; None without one."""
    if stage is None:
        return None
    return {"frames": list(stage.frames), "moves": sorted(stage.moves),
            "reactions": list(stage.reactions),
            "components": {n: [list(c) for c in kept] for n, kept in stage.components.items()},
            "contacts": {name: list(h) for name, h in stage.contacts.items()}}


def stage_arrays(stage: Stage) -> Iterator[tuple[str, tuple[str, ...], dict[str, Any], FloatArray]]:
    """(name, dimensions, attributes, values) of each array of a rigid pre-simulation."""
    yield TIME, (TIME,), {"units": "s"}, stage.times
    for name, h in stage.frames.items():
        motion = np.stack([h.pose, h.rate, h.acceleration], axis=1)
        yield (f"stage.{name}.frame", (TIME, "stage.derivative", f"stage.{name}.coordinate"),
               {"units": POSE_UNITS, "long_name": "pose, rate and acceleration"}, motion)
    for name, forces in stage.reactions.items():
        yield (f"stage.{name}.reaction", (TIME, f"stage.{name}.multiplier"),
               {"units": REACTION_UNITS}, forces)
    for name, histories in stage.contacts.items():
        for what, values in histories.items():
            yield (f"stage.{name}.{what}", (TIME,), {"units": CONTACT_UNITS.get(what, "")}, values)


def read_stage(names: Mapping[str, Any], data: ResultArrays) -> Stage:
    """Rigid pre-simulation of a result. names: the attribute that `stage_attributes` made; data:
    the arrays."""

    def read(name: str) -> FloatArray:
        return data.read(f"stage.{name}")

    times = read("time")
    frames = {n: FrameHistory(times, *read(f"{n}.frame").transpose(1, 0, 2))
              for n in names["frames"]}
    return Stage(times, frames, frozenset(names["moves"]),
                 {n: read(f"{n}.reaction") for n in names["reactions"]},
                 {n: {what: read(f"{n}.{what}") for what in histories}
                  for n, histories in names["contacts"].items()},
                 components={n: tuple((what, si) for what, si in kept)
                             for n, kept in names.get("components", {}).items()})
