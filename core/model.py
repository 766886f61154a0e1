"""An assembled scene: unknowns, equations and start, ready for any reducer."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import BlockData, Part, Term
from sparsemor.core.separable import Separated


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlace:
    """One probe as rows on the unknowns of its body.

    point (2,) body-frame position of the undeformed point, m; displacement (n, 2) weights on the
    elastic block; temperature (m,) weights on the thermal block; base: temperature when the
    point's own is not an unknown (K, a function of time), or None when the body has no heat.
    """

    name: str
    body: str
    point: FloatArray
    displacement: FloatArray | None
    temperature: FloatArray | None
    given: Any
    pose: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """layout, terms and the state at the start. `blocks` has data of each reducible block.

    required: local row numbers of each reducible block that joints and localized loads touch;
    loaded: the same for each load by name, so that a sample that misses one can say which.
    """

    layout: Layout
    parts: Mapping[str, Part]
    terms: tuple[Term, ...]
    separated: Separated
    x0: FloatArray
    v0: FloatArray
    required: Mapping[str, IntArray]
    loaded: Mapping[str, Mapping[str, IntArray]]
    probes: tuple[ProbePlace, ...]
    geometry: Mapping[str, Any]

    def reducible(self) -> tuple[str, ...]:
        return tuple(b.name for b in self.layout if b.field in ("elastic", "thermal"))

    def block_data(self, name: str, snapshots: FloatArray | None = None) -> BlockData:
        """Constant operators and, if given, snapshots (n, M) of one reducible block."""
        n = self.layout[name].stop - self.layout[name].start
        snaps = np.zeros((n, 0)) if snapshots is None else snapshots
        coordinates, component = self.geometry[name]
        for h in self.separated.heat:
            if h.thermal == name:
                return BlockData(name, snaps, h.capacity, h.conductivity, coordinates, component,
                                 h.loads)
        for m in self.separated.moving:
            if m.elastic == name and m.operators is not None:
                ops = m.operators
                return BlockData(name, snaps, ops.mass, ops.stiffness, coordinates, component,
                                 ops.directions)
        raise KeyError(name)
