"""Contact of undeformed surfaces along a prescribed motion, evaluated at many times at once, and
detection of a normal force that oscillates from step to step (chatter)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from sparsemor.bodies.contact.kinematics import attitude_of, crossed
from sparsemor.bodies.contact.overlaps import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.surface import BroadPhase, Surface, balls_in_cells
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core import FloatArray, FrameHistory, IntArray

Motion: TypeAlias = Mapping[str, FrameHistory]
"""Body name -> its prescribed motion; a body without an entry is at rest."""
AT_ONCE = 60_000
"""Approximate number of facet pairs evaluated together: memory of some tens of MB."""


def steps(motion: Motion) -> int:
    """Number of times of a motion."""
    return max((len(h.times) for h in motion.values()), default=1)


class Path:
    """Motion of one body frame at T times.

    R, R1 (T, d): origin, m, and its velocity, m/s; A (T, d, d): rotation matrix; w (T, 1 or 3):
    angular velocity in body axes, rad/s. A body at rest has one row for all times. motion: body ->
    prescribed motion, with poses and their rates (T, n), position first; without one the body rests
    in its initial pose.
    """

    def __init__(self, surface: Surface, motion: Motion) -> None:
        history, d = motion.get(surface.body.name), surface.d
        pose = surface.body.pose[None] if history is None else history.pose
        rate = np.zeros_like(pose) if history is None else history.rate
        if not rate.any() and not np.diff(pose, axis=0).any():
            pose, rate = pose[:1], rate[:1]
        self.R, self.R1 = pose[:, :d], rate[:, :d]
        attitudes = [attitude_of(q, v) for q, v in zip(pose, rate, strict=True)]
        self.A = np.stack([a.A for a in attitudes])
        self.w = np.stack([a.w for a in attitudes])

    def at(self, now: slice) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """R, R1, A, w at the times `now`."""
        now = now if len(self.R) > 1 else slice(0, 1)
        return self.R[now], self.R1[now], self.A[now], self.w[now]


def relative_motion(
    first: Path, second: Path, X: FloatArray, now: slice
) -> tuple[FloatArray, FloatArray]:
    """Positions z (m) and relative velocities (m/s), (T, n, d), of the first body's points X (n,
    d), in the second body's axes, at the times `now`; T = 1 if neither body moves.

    z = B^T (R - S + A X), rate = B^T (R' - S') + C (w x X) - v x z, with origin, rotation matrix
    and angular velocity in body axes R, A, w of the first and S, B, v of the second body.
    """
    R, R1, A, w = first.at(now)
    S, S1, B, v = second.at(now)
    C = B.transpose(0, 2, 1) @ A  # first to second body's axes
    z = (R - S)[:, None] @ B + X @ C.transpose(0, 2, 1)
    own = crossed(w[:, None], X[None]) @ C.transpose(0, 2, 1)
    rate = (R1 - S1)[:, None] @ B + own - crossed(v[:, None], z)
    return z, np.asarray(rate)


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Contact at the consecutive times of a motion from number `begin` up to (not including)
    `stop`, which are evaluated together.

    time (P,): time of each overlap of two facets, counted from `begin`; nodes (P, 2 d): corners of
    these facets, d positions in the `nodes` of each surface; pieces: parts of the overlaps on which
    the tractions are smooth.
    """

    begin: int
    stop: int
    time: IntArray
    nodes: IntArray
    overlaps: Overlaps
    pieces: Pieces

    @property
    def times(self) -> int:
        """Number of times."""
        return self.stop - self.begin


def windows(
    first: Surface, second: Surface, near: BroadPhase, face: Interface, motion: Motion
) -> Iterator[Window]:
    """Overlaps and pieces in contact at all times of the motion, in consecutive windows of times,
    of as many times as make about `AT_ONCE` pairs of facets. Vectors are in the second body's axes.
    near: search for close facets; face: laws of pressure and friction; planes, cells: of the second
    surface's facets, a cell being the prism over a facet whose points belong to it."""
    one, other, all_times = Path(first, motion), Path(second, motion), steps(motion)
    i, j, planes, cells = first.facets, second.facets, second.planes, second.cells
    begin, together = 0, 1
    while begin < all_times:
        stop = min(begin + together, all_times)
        z, rate = relative_motion(one, other, first.X, slice(begin, stop))
        count = stop - begin
        if len(z) < count:
            z, rate = np.repeat(z, count, axis=0), np.repeat(rate, count, axis=0)
        middles = z[:, i].mean(axis=2)
        # pairs: facet f of the first and g of the second surface at time k of the window
        here, g = near.pairs(middles.reshape(-1, first.d), second.tree)
        k, f = np.divmod(here, len(i))
        # pairs in which the first facet's ball may meet the second one's cell
        some = balls_in_cells(middles[k, f], first.radii[f], planes, cells, g)
        k, f, g = k[some], f[some], g[some]
        o, kept = Overlaps.from_pairs(
            Pairs(z[k[:, None], i[f]], rate[k[:, None], i[f]], planes.some(g), cells.some(g)))
        nodes = np.concatenate([i[f[kept]], j[g[kept]]], axis=1)
        yield Window(begin, stop, k[kept], nodes, o, Pieces.cut(o, face.normal, face.friction))
        pairs_per_time = max(len(i), len(here) / count)
        begin, together = stop, max(1, int(AT_ONCE / pairs_per_time))


RESTLESS = 0.02
"""Mean change of the normal force per step, relative to its mean, above which a warning is issued.
"""


def chatter_ratio(normal: FloatArray) -> float:
    """Mean change per step of the normal force (T,) relative to its mean, in the second half of a
    run, if that exceeds `RESTLESS` and the change has another sign than that of the step before in
    more than half of the steps; else 0.

    A motion that the time step resolves reverses less often: faster oscillation is numerical.
    """
    late = normal[len(normal) // 2:]
    change = np.diff(late)
    if len(change) < 8 or not late.any():
        return 0.0
    reversals = float((change[1:] * change[:-1] < 0).mean())
    size = float(np.abs(change).mean() / late.mean())
    return size if reversals > 0.5 and size > RESTLESS else 0.0


def chatter_warning(name: str, normal: FloatArray) -> str:
    """Warning if the normal force (T,), N, of the contact `name` oscillates from step to step; ""
    otherwise."""
    size = chatter_ratio(normal)
    return "" if size == 0.0 else (
        f"contact {name}: to the end its normal force changes by {100 * size:.2g} % from "
        "step to step, back and forth: the step does not resolve the motion on the foundation, "
        "and the integrator does not damp it; forces, and friction above all, are not to be "
        "trusted: take a smaller time.step, or bdf1, bdf2 or a smaller rho_inf")
