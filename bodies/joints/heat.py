"""Heat exchange of a joint: conductance between the mean temperatures of its two sets.

    q = G (T_1 - T_2),    T_i = w_i . T,    rows of body i: +- G w_i (w_1 . T_1 - w_2 . T_2)
"""

from collections.abc import Mapping
from dataclasses import dataclass

from scipy.sparse import csr_array

from sparsemor.bodies.body import Body
from sparsemor.bodies.joints.side import Side
from sparsemor.bodies.targets import find_body
from sparsemor.core import Equations, InputError, Note, Part, information


@dataclass(frozen=True, slots=True, eq=False)
class HeatExchange:
    """Conductance, W/K, between the mean temperatures of two sides. parts: all bodies; those with a
    prescribed temperature are replaced there after the joint is built."""

    sides: tuple[Side, Side]
    conductance: float
    parts: Mapping[str, Part]

    def contribute(self, equations: Equations) -> None:
        """Adds the heat flow to the temperatures of both bodies."""
        one, two = ((self._now(side), side.mean_of_facets) for side in self.sides)
        for (own, w), (far, v) in ((one, two), (two, one)):
            assert own.heat is not None
            block, column = f"{own.name}.thermal", csr_array(w[own.heat.free, None])
            if not equations.size(block):
                continue
            for body, weights, G in ((own, w, self.conductance), (far, v, -self.conductance)):
                assert body.heat is not None
                other = f"{body.name}.thermal"
                if equations.size(other):
                    equations.matrix(block, other, A=csr_array(
                        column @ csr_array(G * weights[None, body.heat.free])))
                for nodes, function in body.heat.prescribed:
                    equations.vector(block, -G * weights[nodes].sum() * w[own.heat.free],
                                     function.value, "prescribed")

    def _now(self, side: Side) -> Body:
        assert side.body is not None
        return find_body(self.parts, side.body.name, side.key)


def heat_exchange(
    name: str, ends: tuple[Side, Side], conductance: float | None, parts: Mapping[str, Part]
) -> tuple[HeatExchange | None, tuple[Note, ...]]:
    """Heat exchange of a joint, None without a conductance; a note if it insulates two bodies with
    temperatures and its conductance is not given.

    InputError for a conductance above 0 of a joint whose sides do not both have temperatures.
    """
    heats = [side.body is not None and side.body.heat is not None for side in ends]
    if conductance is None:
        one, two = (side.body.name if side.body is not None else "" for side in ends)
        return None, (information(
            f"no heat flows through joints.{name} between {one} and {two}: give its conductance "
            "(W/K), or 0 if it insulates", "insulated_joint"),) if all(heats) else ()
    if not conductance or any(
            side.body is not None and side.body.without_fields for side in ends):
        return None, ()
    for side, heat in zip(ends, heats, strict=True):
        if not heat:
            what = "the ground" if side.body is None else f"body {side.body.name!r}"
            raise InputError(f"{what} has no temperature: drop it, give the body the field "
                             "`thermal`, or use a convection load", "conductance")
    return HeatExchange(ends, conductance, parts), ()
