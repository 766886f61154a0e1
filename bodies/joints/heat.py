"""Heat exchange of a joint: conductance between the mean temperatures of its two sets.

    q = G (T_1 - T_2),    T_i = w_i . T,    rows of body i: +- G w_i (w_1 . T_1 - w_2 . T_2)
"""

from collections.abc import Mapping
from dataclasses import dataclass

from scipy.sparse import csr_array

from sparsemor.bodies.body_set import find_body
from sparsemor.bodies.joints.side import Side
from sparsemor.core import Equations, InputError, Note, Part, information
from sparsemor.core.protocols import MeanTemperature


@dataclass(frozen=True, slots=True, eq=False)
class HeatExchange:
    """Conductance, W/K, between the mean temperatures of two sides. parts: all bodies; those with a
    prescribed temperature are replaced there after the joint is built."""

    sides: tuple[Side, Side]
    conductance: float
    parts: Mapping[str, Part]

    def contribute(self, equations: Equations) -> None:
        """Adds the heat flow to the temperatures of both bodies."""
        one, two = map(self._mean, self.sides)
        for (own, T), (far, T_far) in ((one, two), (two, one)):
            block, column = f"{own}.thermal", csr_array(T.weights[:, None])
            if not equations.size(block):
                continue
            for body, mean, G in ((own, T, self.conductance), (far, T_far, -self.conductance)):
                other = f"{body}.thermal"
                if equations.size(other):
                    equations.matrix(block, other, A=csr_array(
                        column @ csr_array(G * mean.weights[None, :])))
                for weight, function in mean.given:
                    equations.vector(block, -G * weight * T.weights, function.value, "prescribed")

    def _mean(self, side: Side) -> tuple[str, MeanTemperature]:
        """Name of the body and mean temperature of a side."""
        assert side.target is not None
        body = find_body(self.parts, side.target.body.name, side.key)
        mean = body.temperature_of(side.target.which)
        assert mean is not None
        return body.name, mean


def heat_exchange(
    name: str, ends: tuple[Side, Side], conductance: float | None, parts: Mapping[str, Part]
) -> tuple[HeatExchange | None, tuple[Note, ...]]:
    """Heat exchange of a joint, None without a conductance; a note if it insulates two bodies with
    temperatures and its conductance is not given.

    InputError for a conductance above 0 of a joint whose sides do not both have temperatures.
    """
    heats = [side.target is not None and (
        side.target.body.temperature_of(side.target.which) is not None) for side in ends]
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
