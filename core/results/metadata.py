"""Metadata of a run, written before its first step."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.body import BodyShape
from sparsemor.core.protocols.layout import Block, FieldKind, Layout
from sparsemor.core.protocols.prescribed_motion import Stage

POSE_UNITS, REACTION_UNITS = "m, rad", "N, N m"
"""Units of rigid coordinates and of joint reactions. Planar rigid coordinates are (Rx, Ry,
theta)."""
CONTACT_UNITS = {"normal": "N", "friction": "N", "power": "W", "length": "m", "area": "m2",
                 "pressure": "Pa"}
"""Units of contact resultants by name."""


@dataclass(frozen=True, slots=True)
class ProbeHeader:
    """Material point that is recorded at each stored step; `position` (d,) in the body frame, m.

    `components` and `units`: names and units of the recorded columns: d coordinates in space and,
    where the body has these fields, d displacements in body axes and a temperature, and where it is
    asked for the stress.
    """

    name: str
    body: str
    position: tuple[float, ...]
    components: tuple[str, ...] = ("x", "y")
    units: tuple[str, ...] = ("m", "m")

    @property
    def displacement(self) -> slice | None:
        """Columns of the displacement; None where it is not recorded."""
        d = len(self.position)
        return slice(d, 2 * d) if len(self.components) >= 2 * d else None

    @property
    def temperature(self) -> int | None:
        """Column of the temperature; None where it is not recorded."""
        return self.components.index("temperature") if "temperature" in self.components else None


@dataclass(frozen=True, slots=True, eq=False)
class RunHeader:
    """Header of a result, written before the first step.

    layout: unknowns of the step solver; full_layout: full-order unknowns; dictionaries: block ->
    affine map (atoms, offset) from the coefficients of a reduced block to its full-order unknowns;
    rows: block -> indices of its sampled rows; step: time step, s; versions: package -> version;
    scene: the scene as plain data; stage: motion and reactions of the rigid pre-simulation that the
    run follows; identity: versions and digests of code, plugins and input files
    (scene/run_identity.py); platform: processor, BLAS library and number of threads; contacts:
    contact -> names of the resultants that are stored; multipliers: block of Lagrange multipliers
    -> (name, unit) of each; estimates: blocks whose error is estimated, estimates_every: number of
    steps from one estimate to the next; fall_back: time, block and reason where the run left its
    reduced model and went on at full order, {} if it did not;
    enriched: times from which it had more atoms, s; forces: force element -> name and unit of its
    force.
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
    probes: tuple[ProbeHeader, ...] = ()
    stage: Stage | None = None
    identity: Mapping[str, Any] = field(default_factory=dict)
    platform: Mapping[str, Any] = field(default_factory=dict)
    contacts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    multipliers: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    estimates: tuple[str, ...] = ()
    estimates_every: int = 0
    fall_back: Mapping[str, Any] = field(default_factory=dict)
    enriched: tuple[float, ...] = ()
    forces: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def attributes(self) -> dict[str, Any]:
        """Attributes of the stored result: the entries of the header that are not arrays, as plain
        data."""
        return {
            "scene": dict(self.scene),
            "scene_digest": self.scene_digest,
            "seed": self.seed,
            "versions": dict(self.versions),
            "identity": dict(self.identity),
            "platform": dict(self.platform),
            "reducer": self.reducer,
            "fields": {k.name: k.plain() for k in self.full_layout.kinds},
            "layout": dump_layout(self.layout),
            "full_layout": dump_layout(self.full_layout),
            "provenance": {name: list(d.provenance) for name, d in self.dictionaries.items()},
            "dictionary_info": {name: dict(d.info) for name, d in self.dictionaries.items()},
            "bodies": list(self.bodies),
            "step": self.step,
            "steps_planned": self.steps_planned,
            "contacts": {name: list(kept) for name, kept in self.contacts.items()},
            "estimates": list(self.estimates),
            "estimates_every": self.estimates_every,
            "fall_back": dict(self.fall_back),
            "enriched": list(self.enriched),
            "forces": {name: list(force) for name, force in self.forces.items()},
            "stage": None if self.stage is None else _stage_names(self.stage),
        }


def _stage_names(stage: Stage) -> dict[str, Any]:
    """Names of the stored quantities of a rigid pre-simulation, as plain data."""
    return {"frames": list(stage.frames), "moves": sorted(stage.moves),
            "reactions": list(stage.reactions),
            "components": {n: [list(c) for c in kept] for n, kept in stage.components.items()},
            "contacts": {name: list(h) for name, h in stage.contacts.items()}}


def dump_layout(layout: Layout) -> list[list[str | int]]:
    return [[b.owner, b.field, b.size] for b in layout]


def load_layout(attributes: Mapping[str, Any], which: str) -> Layout:
    """Layout of the unknowns of a result: `which` is "layout" (step solver) or "full_layout" (full
    order)."""
    kinds = {name: FieldKind.of_plain(data) for name, data in attributes["fields"].items()}
    return Layout([*(Block("", kind, 0) for kind in kinds.values()),
                   *(Block(owner, kinds[name], size) for owner, name, size in attributes[which])])
