"""Quantities recorded next to the unknowns: position, displacement and temperature of material
points (probes), and forces of force elements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.body import ProbePlace
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.joint import ForceLaw, RecordedForce
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.poses import points_in_space
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.results.metadata import ProbeHeader

STRESSES = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Components of the stress."""


@dataclass(frozen=True, slots=True, eq=False)
class AffineOutput:
    """Affine output of one block: value (j,) = base (j,) + weights.T @ x[at].

    weights (k, j): on the k solver unknowns x[at] of the block (coefficients of a reduced block).
    """

    at: slice
    weights: FloatArray
    base: FloatArray

    @classmethod
    def from_weights(
        cls, name: str, weights: FloatArray, layout: Layout, maps: Mapping[str, Dictionary]
    ) -> "AffineOutput":
        """Output of weights (n, j) on the full-order unknowns of block `name`. maps: dictionaries
        of the reduced blocks."""
        if name not in maps:
            return cls(layout[name], weights, np.zeros(weights.shape[1]))
        d = maps[name]
        return cls(layout[name], d.atoms.T @ weights, d.offset @ weights)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values (T, j) at the rows of solver states x (T, n)."""
        # row by row, which is what a stack of columns is: one product for all rows rounds
        # differently for other numbers of rows, and a resumed run commits its rows in other batches
        return np.asarray(self.base + np.matmul(self.weights.T, x[:, self.at, None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class ProbeReader:
    """Evaluation of one probe from the solver's unknowns; its cost does not grow with the mesh.

    place: weights of the probe on the full-order unknowns of its body; rigid: position of the
    body's rigid coordinates in x, None where they are not unknowns.
    """

    place: ProbePlace
    rigid: slice | None
    displacement: AffineOutput | None
    temperature: AffineOutput | None
    stress: tuple[AffineOutput, ...] = ()
    """Parts of its stress."""

    @classmethod
    def at_place(
        cls, place: ProbePlace, layout: Layout, maps: Mapping[str, Dictionary]
    ) -> "ProbeReader":
        """Reader of a probe from the unknowns of a step solver. maps: dictionaries of its reduced
        blocks."""
        frame, moved, heated = (layout.of(place.body, q) for q in (
            Quantity.POSE, Quantity.DISPLACEMENT, Quantity.TEMPERATURE))
        u, T, s = place.displacement, place.temperature, place.stress
        parts = [] if s is None else [(moved, s.displacement), (heated, s.temperature)]
        return cls(
            place, None if frame is None else layout[frame.name],
            None if u is None or moved is None else AffineOutput.from_weights(
                moved.name, u, layout, maps),
            None if T is None or heated is None
            else AffineOutput.from_weights(heated.name, T[:, None], layout, maps),
            tuple(AffineOutput.from_weights(block.name, weights, layout, maps)
                  for block, weights in parts if block is not None and weights is not None))

    @property
    def name(self) -> str:
        return self.place.name

    def header(self) -> ProbeHeader:
        """Name, place, components and units of what the probe records, in the order of its
        values (`__call__`). _stresses: numbers of the stresses that a body of this dimension has
        among xx, yy, zz, xy, yz, xz."""
        axes = ["x", "y", "z"][: len(self.place.point)]
        names, units = axes[:], ["m"] * len(axes)
        if self.displacement is not None:
            names, units = names + [f"u_{a}" for a in axes], units * 2
        if self.temperature is not None:
            names, units = [*names, "temperature"], [*units, "K"]
        if self.place.stress is not None:
            names += [*(f"stress_{STRESSES[i]}" for i in self._stresses), "von_mises"]
            units += ["Pa"] * (len(self._stresses) + 1)
        point = tuple(float(c) for c in self.place.point)
        return ProbeHeader(self.name, self.place.body, point, tuple(names), tuple(units))

    def __call__(self, t: FloatArray, x: FloatArray) -> FloatArray:
        """(j, components) values of the probe at times t (j,), s, for solver states x (j, n)."""
        d = len(self.place.point)
        u = np.zeros((len(t), d)) if self.displacement is None else self.displacement(x)
        columns = [*points_in_space(self._pose(t, x), self.place.point + u).T]
        if self.displacement is not None:
            columns += [*u.T]
        if self.temperature is not None:
            T = self.temperature(x)[:, 0]
            for weight, function in self.place.given:
                T = T + weight * np.array([function.value(s) for s in t])
            columns.append(T)
        if self.place.stress is not None:
            # s (j, 6): stresses xx, yy, zz, xy, yz, xz, Pa
            s = self.place.stress.base + sum(part(x) for part in self.stress)
            for weights, function in self.place.stress.given:
                s = s + np.outer([function.value(r) for r in t], weights)
            # von Mises: sqrt(3/2 s : s) of the deviator s, with normal and shear components n, m
            n, m = s[:, :3], s[:, 3:]
            columns += [*s[:, self._stresses].T, np.sqrt(
                1.5 * ((n - n.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
                + 3.0 * (m**2).sum(axis=1))]
        return np.stack(columns, axis=1)

    @property
    def _stresses(self) -> list[int]:
        """Numbers of the components of stress that a body of its dimension has."""
        return [0, 1, 2, 3] if len(self.place.point) == 2 else list(range(6))

    def _pose(self, t: FloatArray, x: FloatArray) -> FloatArray:
        """(j, 3), (j, 4) or (j, 7) rigid coordinates of the body's frame at times t (j,)."""
        if self.rigid is not None:
            return x[:, self.rigid]
        if self.place.guide is not None:
            return self.place.guide.along(t)[0]
        return np.tile(self.place.pose, (len(t), 1))

    def described(self, row: FloatArray) -> dict[str, Any]:
        """Position (m), displacement (m), temperature (K) and stress (Pa), as far as they are
        recorded, of one row by name; the columns are in this order, with the von Mises stress
        behind."""
        values = [float(v) for v in row]
        d = len(self.place.point)
        found: dict[str, Any] = {"position": values[:d]}
        if self.displacement is not None:
            found["displacement"] = values[d : 2 * d]
        if self.temperature is not None:
            found["temperature"] = values[d if self.displacement is None else 2 * d]
        if self.place.stress is not None:
            found["stress"] = values[-len(self._stresses) - 1 : -1]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class ForceReader:
    """Evaluation of the force of one force element from the solver's rigid coordinates.

    component: name and unit; ends: of each of its sides the position of the rigid coordinates in x,
    or its motion where it is no unknown.
    """

    name: str
    component: tuple[str, str]
    law: ForceLaw
    ends: tuple[slice | FrameHistory, slice | FrameHistory]

    @classmethod
    def from_force(cls, name: str, force: RecordedForce, layout: Layout) -> "ForceReader":
        one, two = (layout[e] if isinstance(e, str) else e for e in force.moved_by)
        return cls(name, force.component, force.law, (one, two))

    def __call__(
        self, times: FloatArray, x: FloatArray, rates: Mapping[int, FloatArray]
    ) -> FloatArray:
        """(j,) force at times (j,), s, for solver states x (j, n). rates: first column of rigid
        coordinates -> their rates (j, size)."""
        return self.law(times, [
            (x[:, e], rates[e.start]) if isinstance(e, slice) else e.along(times)[:2]
            for e in self.ends])

    def bounded_angle(self, state: State) -> FloatArray | None:
        """Angle of its law (1,), rad, in a solver state, where it is known up to a limit only; None
        for other laws."""
        t = np.array([state.t])
        own, other = (state.x[None, e] if isinstance(e, slice) else e.along(t)[0]
                      for e in self.ends)
        return self.law.bounded_angle(t, own, other)


def rate_columns(readers: Sequence[ForceReader]) -> Mapping[int, slice]:
    """First column -> columns of the rigid coordinates whose rates the readers need."""
    return {e.start: e for r in readers for e in r.ends if isinstance(e, slice)}
