"""A body of somebody else: an insulated rod that is heated at one end, in finite volumes.

    c dT_i/dt = k (T_(i-1) - 2 T_i + T_(i+1)) + q_i

It is written with the public names of `sparsemor.core` alone, to the protocols `BodyPlugin`,
`Body`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.core import (
    Block,
    Body,
    BodyPlugin,
    Csr,
    Equations,
    FieldKind,
    FloatArray,
    FrameHistory,
    IntArray,
    Quantity,
)

WARMTH = FieldKind("warmth", order=1, unit="K", quantity=Quantity.TEMPERATURE, reducible=True)
"""Kind of its unknowns: temperatures of cells."""


class Rod(BodyPlugin):
    """Insulated rod of equal cells, heated in the first one."""

    cells: int = Field(ge=2)
    """Number of cells."""
    capacity: float = Field(gt=0)
    """Heat capacity of a cell, J/K."""
    conductance: float = Field(gt=0)
    """Conductance between neighbours, W/K."""
    power: float = 0.0
    """Heat into the first cell, W."""
    fields: list[Literal["warmth"]] = ["warmth"]
    """A rod without its field has no unknowns."""

    @property
    def selected_fields(self) -> Sequence[str]:
        return self.fields

    def build(self, name: str, base: Path) -> "BuiltRod":
        n = self.cells if self.fields else 0
        C = csr_array(self.capacity * np.eye(n))
        steps = np.eye(n)[1:] - np.eye(n)[:-1]
        q = np.zeros(n)
        q[:1] = self.power
        return BuiltRod(name, C, csr_array(self.conductance * (steps.T @ steps)), q)


@dataclass(frozen=True)
class BuiltRod(Body):
    """The built body: a thermal block in a frame at rest."""

    name: str
    C: Csr
    K: Csr
    q: FloatArray
    pose: FloatArray = field(default_factory=lambda: np.zeros(3))

    def with_motion(self, motion: FrameHistory) -> "BuiltRod":
        return self

    def blocks(self) -> Sequence[Block]:
        return [Block(self.name, WARMTH, len(self.q))]

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        n = len(self.q)
        places = np.stack([np.arange(n, dtype=np.float64), np.zeros(n)], axis=1)
        return {f"{self.name}.warmth": (places, np.zeros(n, np.int64))} if n else {}

    def contribute(self, equations: Equations) -> None:
        if len(self.q):
            block = f"{self.name}.warmth"
            equations.matrix(block, block, A=self.K, B=self.C)
            equations.vector(block, self.q)
