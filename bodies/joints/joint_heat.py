"""Heat exchange of a joint: conductance between the mean temperatures of its two sets.

    q = G (T_1 - T_2),    T_i = w_i . T,    rows of body i: +- G w_i (w_1 . T_1 - w_2 . T_2)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.body_set import find_body
from sparsemor.bodies.frames.plane_springs import relative_law
from sparsemor.bodies.frames.springs import RelativeItem
from sparsemor.bodies.joints.joint_sides import Side
from sparsemor.core import (
    Csr,
    Equations,
    FloatArray,
    FrameHistory,
    InputError,
    IntArray,
    Note,
    Part,
    ReducedTerm,
    Table,
    Term,
    Trial,
    information,
)
from sparsemor.core.protocols.body import MeanTemperature
from sparsemor.core.protocols.load_tables import LoadTable


@dataclass(frozen=True, slots=True, eq=False)
class HeatExchange:
    """Conductance, W/K, between the mean temperatures of two sides. parts: all bodies; those with a
    prescribed temperature are replaced there after the joint is built."""

    sides: tuple[Side, Side]
    conductance: float
    parts: Mapping[str, Part]

    def contribute(self, equations: Equations) -> None:
        """Adds the heat flow G w_own (w_own . T_own - w_far . T_far) to the temperatures of both
        bodies, on the left-hand side; w: weights of unknown temperatures in the mean. Prescribed
        ones in a mean, `given` as weight and function of time, are loads, on the right-hand
        side."""
        one, two = map(self._mean, self.sides)
        for (own, T), (far, T_far) in ((one, two), (two, one)):
            block, column = f"{own}.thermal", csr_array(T.weights[:, None])
            if not equations.size(block):  # all its temperatures are prescribed
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

    InputError for a conductance above 0 of a joint whose sides do not both have temperatures; not
    for rigid copies of bodies with fields, in a rigid-body pre-simulation (without_fields).
    """
    heats = [side.target is not None and (
        side.target.body.temperature_of(side.target.which) is not None) for side in ends]
    if conductance is None and not all(heats):
        return None, ()
    if conductance is None:
        one, two = (side.body.name if side.body is not None else "" for side in ends)
        return None, (information(
            f"no heat flows through joints.{name} between {one} and {two}: give its conductance "
            "(W/K), or 0 if it insulates", "insulated_joint"),)
    if not conductance or any(
            side.body is not None and side.body.without_fields for side in ends):
        return None, ()
    for side, heat in zip(ends, heats, strict=True):
        if not heat:
            what = "the ground" if side.body is None else f"body {side.body.name!r}"
            raise InputError(f"{what} has no temperature: drop it, give the body the field "
                             "`thermal`, or use a convection load", "conductance")
    return HeatExchange(ends, conductance, parts), ()


STEP = 1e-6
"""Step of finite differences by rigid coordinates, m or 1, for the Jacobian alone."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPower:
    """Power of friction f(q', |F|) q', W, as a function of rigid coordinates and joint forces F.

    Unknowns x (n,): rigid coordinates of the own side, of the other side (`sizes` of them, 0 for a
    side that stands or follows a prescribed motion `guides`), then the joint forces. item: law f
    and coordinate q.
    """

    item: RelativeItem
    sizes: tuple[int, int]
    guides: tuple[FrameHistory, FrameHistory]

    def rates(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Rates q' (T,) of the relative coordinate at T states x, v (T, n), all at time t, s: of
        both sides' rigid coordinates, `sizes` of them in x and v, or 0 of one along its
        `guides`."""
        first, ends = 0, []
        for size, guide in zip(self.sizes, self.guides, strict=True):
            at = slice(first, first + size)
            if size:
                ends.append((x[:, at], v[:, at]))
            else:
                y, rate, _ = guide.at(t)
                ends.append((np.tile(y, (len(x), 1)), np.tile(rate, (len(x), 1))))
            first += size
        return np.asarray(self.item.moved(np.full(len(x), t), *ends)[1])

    def __call__(self, x: FloatArray, v: FloatArray, t: float) -> float:
        """The power at unknowns x (n,) and their rates v; friction depends on no value q."""
        load = float(np.linalg.norm(x[sum(self.sizes):]))
        rate = float(self.rates(x[None], v[None], t)[0])
        force, *_ = relative_law(*self.item.law, q=0.0, rate=rate, load=load)
        return float(force * rate)

    def slopes(self, x: FloatArray, v: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n,) of the power f(q', L) q' by x and by v, L = |F| of the joint forces F =
        x[m:]. Those of the rate q' by the m rigid coordinates are central differences, by their
        rates exact ones, as q' is linear in them."""
        n, m = len(x), sum(self.sizes)
        rate = float(self.rates(x[None], v[None], t)[0])
        load = float(np.linalg.norm(x[m:]))
        f, _, by_rate, by_load = relative_law(*self.item.law, q=0.0, rate=rate, load=load)
        rate_by_x, rate_by_v, one = np.zeros(n), np.zeros(n), np.eye(n)[:m]
        if m:
            rate_by_v[:m] = self.rates(np.tile(x, (m, 1)), v + one, t) - rate
            after, before = (self.rates(x + s * STEP * one, np.tile(v, (m, 1)), t) for s in (1, -1))
            rate_by_x[:m] = (after - before) / (2.0 * STEP)
        power_by_rate = f + by_rate * rate
        by_x = power_by_rate * rate_by_x
        if load:
            by_x[m:] = by_load * rate * x[m:] / load
        return by_x, power_by_rate * rate_by_v


@dataclass(frozen=True, slots=True, eq=False)
class FrictionHeat(Term):
    """Heat -weights (m,) times the power of friction, W, in the rows of temperatures, on the
    left-hand side; weights: share of each row. columns (n,): positions of the unknowns of `power`
    in the state vector; c1 (n,): dv = c1 dx."""

    rows: IntArray
    columns: IntArray
    weights: FloatArray
    power: FrictionPower
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return -self.weights * self.power(x, v, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        by_x, by_v = self.power.slopes(x, v, t)
        return csr_array(-np.outer(self.weights, by_x + by_v * c1))

    def restrict(self, keep: IntArray) -> Self:
        return replace(self, rows=self.rows[keep], weights=self.weights[keep])

    def compress(self, trial: Trial, left: FloatArray) -> "ReducedFrictionHeat":
        return ReducedFrictionHeat(left @ self.weights, self.power, trial, self.source)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedFrictionHeat(ReducedTerm):
    """Projected heat of friction -weights (l,) times the power, at the unknowns offset + atoms x of
    k reduced ones; c1 (k,): dv = c1 dx. slopes: derivatives of the power by the unknowns and by
    their rates."""

    weights: FloatArray
    power: FrictionPower
    trial: Trial
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        T = self.trial
        return -self.weights * self.power(T.offset + T.atoms @ x, T.atoms @ v, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        T = self.trial
        by_x, by_v = self.power.slopes(T.offset + T.atoms @ x, T.atoms @ v, t)
        return -np.outer(self.weights, by_x @ T.atoms + (by_v @ T.atoms) * c1)


@dataclass(frozen=True, slots=True, eq=False)
class HeatOfFriction:
    """Heat of a friction element. ends: the sets of the scene; shares: of the power that enter
    them. parts: all bodies; those with a prescribed temperature are replaced there after the
    element is built."""

    ends: tuple[Side, Side]
    shares: tuple[float, float]
    parts: Mapping[str, Part]

    def weights(self, equations: Equations) -> list[tuple[str, FloatArray]]:
        """Name of each temperature block that is heated, and its share of the power (m,)."""
        found = []
        for side, share in zip(self.ends, self.shares, strict=True):
            if side.target is None or not share:
                continue
            body = find_body(self.parts, side.target.body.name, side.key)
            mean, block = body.temperature_of(side.target.which), f"{body.name}.thermal"
            if mean is not None and equations.size(block):
                found.append((block, share * mean.weights))
        return found

    def contribute(
        self, equations: Equations, item: RelativeItem, sides: tuple[Side, Side], block: str
    ) -> None:
        """Adds the heat for an item that acts on rigid coordinates of `sides`, as a term of these
        and of the item's first multipliers; block: of the multipliers that its law reads, "" for
        none. weights: of each heated temperature block, share of the power in each row; over_steps:
        mean values of its functions of time in the steps of the run."""
        item = equations.over_steps(item)
        frames = [f"{s.reads}.rigid" if s.reads else "" for s in sides]
        none = np.zeros(0, np.int64)
        own, other = (equations.numbers(f) if f else none for f in frames)
        forces = equations.numbers(block)[: item.forces] if block else none
        power = FrictionPower(item, (len(own), len(other)), (sides[0].motion, sides[1].motion))
        columns = np.concatenate([own, other, forces])
        for name, weights in self.weights(equations):
            used = np.flatnonzero(weights)
            blocks = [name, *(b for b in (*frames, block) if b)]
            equations.local(blocks, FrictionHeat(
                equations.numbers(name)[used], columns, weights[used], power))

    def contribute_along(
        self, equations: Equations, item: RelativeItem, sides: tuple[Side, Side]
    ) -> None:
        """Adds the heat along a prescribed motion of both sides, as a table over its times:
        friction that reads joint forces is refused there, so that the power has no unknowns. A side
        at rest has one time."""
        motion = [s.motion for s in sides]
        times = max((m.times for m in motion), key=len)
        power = FrictionPower(item, (0, 0), (motion[0], motion[1]))
        nothing = np.zeros(0)
        values = np.array([[power(nothing, nothing, t)] for t in times.tolist()])
        for name, weights in self.weights(equations):
            equations.table(name, LoadTable(equations.origin.part, csr_array(weights[:, None]),
                                            ("heat of friction",), Table(times, values)))


def heat_of_friction(
    name: str, ends: Sequence[Side], share: float | None, parts: Mapping[str, Part]
) -> tuple[HeatOfFriction | None, tuple[Note, ...]]:
    """Heat of a friction element of which a share enters the first of its two sides, None without
    one; a note if some of it leaves the model.

    InputError if neither side has a temperature.
    """
    if share is None or any(s.body is not None and s.body.without_fields for s in ends):
        return None, ()
    one, two = ends
    hot = [s.target is not None and s.target.body.temperature_of(s.target.which) is not None
           for s in ends]
    if not any(hot):
        raise InputError("neither side has a temperature: drop it, or give a body the field "
                         "`thermal`", "heat")
    shares = share, 1.0 - share
    lost = sum(s for s, has in zip(shares, hot, strict=True) if not has)
    notes = (information(
        f"joints.{name}: {100 * lost:.3g} % of the heat of friction goes to a side without "
        "temperature, and leaves the model", "friction_heat"),) if lost else ()
    return HeatOfFriction((one, two), shares, parts), notes
