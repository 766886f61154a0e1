"""The pieces in contact at many times of a known motion, a few times at once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.part import Motion, steps
from sparsemor.bodies.contact.spatial.cells import reached
from sparsemor.bodies.contact.spatial.path import Path, seen
from sparsemor.bodies.contact.spatial.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols import NormalLaw

AT_ONCE = 60_000
"""Pairs of facets, about, that are evaluated together: memory for some tens of MB."""


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """Times begin to stop; time (P,) of each overlap, counted from begin, and its nodes (P, 6),
    three of either surface."""

    begin: int
    stop: int
    time: IntArray
    nodes: IntArray
    overlaps: Overlaps
    pieces: Pieces

    @property
    def times(self) -> int:
        return self.stop - self.begin


def meetings(
    first: Surface, second: Surface, near: Near, normal: NormalLaw,
    motion: Motion,
) -> Iterator[Meeting]:
    """Of rigid surfaces at all times, in order."""
    one, other, all_times = Path(first, motion), Path(second, motion), steps(motion)
    i, j, planes, cells = first.facets, second.facets, second.planes, second.cells
    begin, together = 0, 1
    while begin < all_times:
        stop = min(begin + together, all_times)
        z, rate = seen(one, other, first.X, slice(begin, stop))
        count = stop - begin
        if len(z) < count:
            z, rate = np.repeat(z, count, axis=0), np.repeat(rate, count, axis=0)
        middles = z[:, i].mean(axis=2)
        here, g = near.pairs(middles.reshape(-1, 3), second.tree)
        k, f = np.divmod(here, len(i))
        some = reached(middles[k, f], first.radii[f], planes, cells, g)
        k, f, g = k[some], f[some], g[some]
        o, kept = Overlaps.of(Pairs(z[k[:, None], i[f]], rate[k[:, None], i[f]], planes.some(g),
                                    cells.some(g)))
        nodes = np.concatenate([i[f[kept]], j[g[kept]]], axis=1)
        yield Meeting(begin, stop, k[kept], nodes, o, Pieces.cut(o, normal))
        each = max(len(i), len(here) / count)
        begin, together = stop, max(1, int(AT_ONCE / each))
