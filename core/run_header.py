"""What a run says about itself before its first step."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Dictionary, TimeFunction
from sparsemor.core.stage import Stage

UNITS = {"rigid": "m, rad", "elastic": "m", "thermal": "K", "multiplier": "N, N m"}
CONTACT_UNITS = {"normal": "N", "friction": "N", "power": "W", "length": "m", "area": "m2",
                 "pressure": "Pa"}
"""Units of a block's entries. Planar rigid blocks are (Rx, Ry, theta)."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyShape:
    """The mesh of one body and how its unknowns sit on it.

    points (N, d) reference positions, m; cells (E, d + 1). elastic_dofs (n,): flat position
    `d * node + component` of each elastic unknown; thermal_nodes (n,): node of each thermal
    unknown; None where the body has no such field. Nodes without an unknown take
    `eliminated_displacement` (N, d), m, or 0; `eliminated_temperature` (N,), K, or 0, unless they
    are among those of `given`: nodes, and the function of time that their temperature follows.
    pose: of the body's frame at the start, where a frame without unknowns stays unless it follows
    a stage.
    """

    points: FloatArray
    cells: IntArray
    elastic_dofs: IntArray | None = None
    thermal_nodes: IntArray | None = None
    eliminated_displacement: FloatArray | None = None
    eliminated_temperature: FloatArray | None = None
    pose: FloatArray | None = None
    given: tuple[tuple[IntArray, TimeFunction], ...] = ()

    def given_at(self, times: FloatArray) -> FloatArray:
        """(j, functions) given temperatures at times (j,), s."""
        return np.array([[f.value(float(t)) for _, f in self.given] for t in times])

    @property
    def given_of(self) -> IntArray:
        """(N,): which of `given` each node follows, -1 for none."""
        which: IntArray = np.full(len(self.points), -1, np.int64)
        for i, (nodes, _) in enumerate(self.given):
            which[nodes] = i
        return which


@dataclass(frozen=True, slots=True)
class Probe:
    """A point that is recorded each stored step; `position` (d,) in the body frame, m.

    `components` and `units` name the columns of what the run hands in, in the same order.
    """

    name: str
    body: str
    position: tuple[float, ...]
    components: tuple[str, ...] = ("x", "y")
    units: tuple[str, ...] = ("m", "m")


@dataclass(frozen=True, slots=True, eq=False)
class RunHeader:
    """Everything that is known before the first step.

    layout: the solver's own unknowns; full_layout: the full-order ones. dictionaries: block ->
    map back to full unknowns (absent: the block is kept as it is). rows: block -> sampled rows.
    step: s. versions: distribution -> version. scene: the plain dump of the scene. stage: the
    histories that the run follows. identity: of code, plugins and files (core/identity.py).
    platform: processor, BLAS and its threads (core/threads.py). contacts: contact -> names of the
    resultants that are kept at the stored steps. multipliers: block -> name and unit of each of
    its unknowns.
    """

    scene: Mapping[str, Any]
    scene_digest: str
    seed: int
    versions: Mapping[str, str]
    reducer: str
    layout: Layout
    full_layout: Layout
    step: float
    steps_planned: int
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    bodies: Mapping[str, BodyShape] = field(default_factory=dict)
    probes: tuple[Probe, ...] = ()
    budgets: Mapping[str, Any] = field(default_factory=dict)
    stage: Stage | None = None
    identity: Mapping[str, Any] = field(default_factory=dict)
    platform: Mapping[str, Any] = field(default_factory=dict)
    contacts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    multipliers: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def attributes(self) -> dict[str, Any]:
        """The part of the header that is not arrays, as plain data."""
        return {
            "scene": dict(self.scene),
            "scene_digest": self.scene_digest,
            "seed": self.seed,
            "versions": dict(self.versions),
            "identity": dict(self.identity),
            "platform": dict(self.platform),
            "reducer": self.reducer,
            "layout": dump_layout(self.layout),
            "full_layout": dump_layout(self.full_layout),
            "provenance": {name: list(d.provenance) for name, d in self.dictionaries.items()},
            "dictionary_info": {name: dict(d.info) for name, d in self.dictionaries.items()},
            "bodies": list(self.bodies),
            "budgets": dict(self.budgets),
            "step": self.step,
            "steps_planned": self.steps_planned,
            "contacts": {name: list(kept) for name, kept in self.contacts.items()},
        }


def dump_layout(layout: Layout) -> list[list[Any]]:
    return [[b.owner, b.field, b.size] for b in layout]


def load_layout(dump: list[list[Any]]) -> Layout:
    return Layout(Block(owner, kind, size) for owner, kind, size in dump)
