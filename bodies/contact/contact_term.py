"""Contact of two surfaces as a term of the equations of motion and heat, in the plane and in space.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.contact.bristles import Bristles, Sliding
from sparsemor.bodies.contact.contact_unknowns import (
    ContactSide,
    Sizes,
    found_in,
    picked,
    renumbered,
)
from sparsemor.bodies.contact.kinematics import Kinematics, too_deep
from sparsemor.bodies.contact.overlaps import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.surface import BroadPhase, Planes, balls_in_cells, radii_of, tree_of
from sparsemor.bodies.contact.tangent import Tangent, summed
from sparsemor.bodies.contact.tractions import ContactLoads, Interface, names_of, nodal, resultants
from sparsemor.bodies.contact.verlet_list import FollowedContact, Mover
from sparsemor.core import BoolArray, Csr, FloatArray, IntArray, Term, Trial
from sparsemor.core.model.compressed_local import CompressedLocal


@dataclass(frozen=True, slots=True, eq=False)
class _Evaluation:
    """Contact of two surfaces at one state, in the second body's axes. P overlaps of a facet of
    each; nodes (P, 2 d): corners of both facets, the second surface's nodes numbered after the
    first's; pieces: parts of overlaps with smooth tractions; loads: forces and heats of these; T
    (P, 2 d): temperatures at the nodes, K, None without conduction; sliding, rate (k, d), m/s: slip
    of the k bristles, and rates of their deflections."""

    kinematics: Kinematics
    nodes: IntArray
    overlaps: Overlaps
    pieces: Pieces
    loads: ContactLoads
    T: FloatArray | None
    sliding: Sliding | None
    rate: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ContactTerm(Term):
    """Contact contribution to the residual: minus the generalized forces and heats that act between
    two surfaces. rows, columns: global numbers of the equations and unknowns; near: search for
    close facets; deforms: nodes move with the displacements, so facets are searched in the deformed
    state; reach: largest admissible penetration, m; active: masks (F,) of the facets of each
    surface that are evaluated (against all of the other surface). reads, writes: positions in
    `columns` and `rows` of the local unknowns (contact_unknowns.py), then of the temperatures and
    of the deflections of bristles; -1: none."""

    rows: IntArray
    columns: IntArray
    sides: tuple[ContactSide, ContactSide]
    face: Interface
    near: BroadPhase
    deforms: bool
    reach: float
    active: tuple[BoolArray, BoolArray]
    reads: IntArray
    writes: IntArray
    bristles: Bristles | None = None
    source: str = ""

    @classmethod
    def between(
        cls, sides: tuple[ContactSide, ContactSide], face: Interface, near: BroadPhase,
        deforms: bool, reach: float, bristles: Bristles | None, deflections: IntArray,
    ) -> Self:
        """Term with all unknowns of both sides and the deflections of bristles (their numbers in
        the state vector, as all here, -1 for prescribed ones). near: search for close facets;
        deforms: surfaces move with displacements; reach: largest admissible penetration, m. reads,
        writes: position in `columns` and `rows` of each local unknown, in this order."""
        one, two = sides
        numbers = np.concatenate([one.frame, two.frame, one.u, two.u, one.T, two.T, deflections])
        columns = np.unique(numbers[numbers >= 0])
        at = found_in(numbers, columns)
        first, second = (np.ones(len(s.surface.facets), bool) for s in sides)
        return cls(columns, columns, sides, face, near, deforms, reach, active=(first, second),
                   reads=at, writes=at, bristles=bristles)

    @property
    def elements(self) -> int:
        """Number of evaluated facets of the first surface, each against close facets of the second.
        """
        first, second = (int(a.sum()) for a in self.active)
        return min(len(self.active[0]), first + second)

    @property
    def _whole(self) -> bool:
        """True if every pair of facets is evaluated."""
        return bool(self.active[0].all() or self.active[1].all())

    # ------------------------------------------------------------------ evaluation

    def _kinematics(self, x: FloatArray, v: FloatArray, t: float) -> Kinematics | None:
        """Kinematics of both surfaces; None if the state is not finite."""
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return None
        local = self.reads[: Sizes.from_sides(*self.sides).whole]
        here = Kinematics(self.sides, picked(x, local), picked(v, local), t)
        return here if here.finite else None

    def _evaluate(self, x: FloatArray, v: FloatArray, t: float) -> _Evaluation | None:
        """Overlaps of the surfaces at a state, with nodal forces and heats; None if it is not
        finite. x, v: unknowns at the term's columns, and rates. here: node positions a, b (m) and
        velocities va, vb of both surfaces in the second body's axes; bristles are evaluated by the
        overlaps without them, and then added as their deflections z."""
        here = self._kinematics(x, v, t)
        if here is None:
            return None
        first, second = (s.surface for s in self.sides)
        moves = len(self.sides[1].u) > 0  # the second surface deforms
        planes = Planes.from_corners(here.b[second.facets]) if moves else second.planes
        # pairs: facet f of the first surface with nodes i, g of the second with nodes j
        f, g = self._pairs(here, planes)
        i, j, planes = first.facets[f], second.facets[g], planes.some(g)
        cells = second.cells_at(g, planes) if moves else second.cells.some(g)
        pairs = Pairs(here.a[i], here.va[i], planes, cells, vb=here.vb[j] if moves else None)
        o, kept = Overlaps.from_pairs(pairs)
        nodes = np.concatenate([i[kept], len(first.nodes) + j[kept]], axis=1)
        pieces = Pieces.cut(o, self.face.normal, self.face.friction)
        T = self._temperatures(x, t)[nodes] if self.face.conductance > 0 else None
        sliding, rate = None, np.zeros((0, here.sizes.d))
        if self.bristles is not None:
            z, rate = (self._deflections(f) for f in (x, v))
            sliding = self.bristles.sliding(o, pieces, self.face, i[kept], z)
            o = self.bristles.on(o, i[kept], z, rate)
        return _Evaluation(here, nodes, o, pieces, nodal(o, pieces, self.face, T), T, sliding, rate)

    def _deflections(self, x: FloatArray) -> FloatArray:
        """(k, d) values of x (N,) at the deflections of the bristles."""
        n = Sizes.from_sides(*self.sides)
        return picked(x, self.reads[n.all :]).reshape(-1, n.d)

    def _pairs(self, here: Kinematics, planes: Planes) -> tuple[IntArray, IntArray]:
        """Numbers of the facets of the first and of the second surface in each evaluated pair:
        close facets of which one is active and, in space, where the first one's ball may meet the
        second one's cell (the undeformed one). here.a, here.b: node positions; planes: of second
        facets; _whole: all facets of a surface are active, so that every pair has an active one."""
        first, second = (s.surface for s in self.sides)
        corners = here.a[first.facets]
        middles = corners.mean(axis=1)
        tree = tree_of(here.b, second.facets) if len(self.sides[1].u) else second.tree
        f, g = self.near.pairs(middles, tree)
        if not self._whole:
            wanted = self.active[0][f] | self.active[1][g]
            f, g = f[wanted], g[wanted]
        if first.d == 2:  # they are few
            return f, g
        some = balls_in_cells(middles[f], radii_of(corners)[f], planes, second.cells, g)
        return f[some], g[some]

    def _temperatures(self, x: FloatArray, t: float) -> FloatArray:
        """(n1 + n2,) temperatures of all nodes, K: unknowns in x (N,), and prescribed ones."""
        unknown = picked(x, self.reads[Sizes.from_sides(*self.sides).whole :])
        first, second = self.sides
        n = len(first.T)
        return np.concatenate([first.held.filled(unknown[:n], t),
                               second.held.filled(unknown[n : n + len(second.T)], t)])

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        """Forces and heats at the nodes of both surfaces and on their frames, with minus sign; nan
        for a state that is not finite. Bristles with the deflection z: z' - (V - lost) = 0. writes:
        row of each local unknown (frames, displacements, temperatures, bristles), -1 for none;
        elements: number of active facets, 0 for a term restricted to rows without contact."""
        if not self.elements:
            return np.zeros(len(self.rows))
        now = self._evaluate(x, v, t)
        if now is None:
            return np.full(len(self.rows), np.nan)
        local = np.concatenate([now.kinematics.rows(self._forces(now)), self._heats(now)])
        if now.sliding is not None:
            free = now.sliding.V - now.sliding.lost - now.rate
            local = np.concatenate([local, free.ravel()])
        kept = self.writes >= 0
        return -np.bincount(self.writes[kept], local[kept], minlength=len(self.rows)).astype(
            np.float64)

    def _forces(self, now: _Evaluation) -> FloatArray:
        """(n1 + n2, d) contact forces at all nodes, N, in the second body's axes."""
        n = now.kinematics.sizes
        at, f = now.nodes[now.pieces.overlap].ravel(), now.loads.force.reshape(-1, n.d)
        return np.array([np.bincount(at, c, n.n1 + n.n2) for c in f.T], dtype=np.float64).T

    def _heats(self, now: _Evaluation) -> FloatArray:
        """(n1 + n2,) heats at all nodes, W."""
        n, at = now.kinematics.sizes, now.nodes[now.pieces.overlap].ravel()
        return np.bincount(at, now.loads.heat.ravel(), n.n1 + n.n2).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """Derivatives of the residual (minus the forces and heats), as the sum of a dense block for
        each pair of facets, and of the bristles; c1 (n,): dv = c1 dx. at (P, m): local unknowns of
        each pair, which are at `reads` in the columns and `writes` in the rows, -1 for none; the
        first n.frames of them are the rigid coordinates of both bodies, and those from n.all on the
        bristles. own: bristles by themselves. elements: number of active facets.
        """
        shape = len(self.rows), len(self.columns)
        if not self.elements:
            return csr_array(shape)
        now = self._evaluate(x, v, t)
        if now is None:
            return csr_array(np.full(shape, np.nan))
        own = self._of_bristles(now.sliding, c1)
        if not len(now.nodes):
            return csr_array(own, shape=shape)
        n = now.kinematics.sizes
        local, at = self._of_pairs(now, picked(c1, self.reads)), n.of_pairs(now.nodes)
        if self.bristles is not None:
            at = np.concatenate([at, n.all + self.bristles.numbers(now.nodes[:, : n.d])], axis=1)
        # rows and columns of the frames are those of every pair: their sum is put at the first
        local[0, : n.frames, : n.frames] = local[:, : n.frames, : n.frames].sum(axis=0)
        i, j = self.writes[at][:, :, None], self.reads[at][:, None]
        kept = (i >= 0) & (j >= 0)
        kept[1:, : n.frames, : n.frames] = False
        i, j = (np.broadcast_to(k, kept.shape)[kept] for k in (i, j))
        data, (rows, columns) = own
        return csr_array((np.concatenate([-local[kept], data]), (
            np.concatenate([i, rows]), np.concatenate([j, columns]))), shape=shape)

    def _of_bristles(
        self, now: Sliding | None, c1: FloatArray
    ) -> tuple[FloatArray, tuple[IntArray, IntArray]]:
        """Derivatives of the bristles' rows z' - V + lost(z) by their own deflections z: values,
        rows and columns of d x d blocks, d(lost)/dz + c1; c1 (n,): dv = c1 dx, at the columns.
        reads, writes: columns and rows of the local unknowns, those of bristles from `start` on;
        -1: none.
        """
        start = Sizes.from_sides(*self.sides).all
        at = self.reads[start:]
        if now is None:
            return np.zeros(0), (at, at)
        d = now.V.shape[1]
        own = now.lost_z + picked(c1, at).reshape(-1, d, 1) * np.eye(d)
        i, j = (np.broadcast_to(p.reshape(s), own.shape) for p, s in (
            (self.writes[start:], (-1, d, 1)), (at, (-1, 1, d))))
        kept = (i >= 0) & (j >= 0)
        return own[kept], (i[kept], j[kept])

    def _of_pairs(self, now: _Evaluation, c1: FloatArray) -> FloatArray:
        """(P, size, size) derivatives of the generalized forces and heats of each pair, and of the
        free motion of its bristles, by its unknowns, in the order of `Sizes.of_pairs`; c1:
        derivatives of rates, by local number.

        Rows and columns: up to f frames, up to m displacements, up to w temperatures, then d^2
        bristles. Only the first pair has the derivatives of the frames' rows for constant forces,
        which are sums over all pairs. Blocks that stay zero: forces depend on no temperature, free
        motion on neither temperatures nor bristles (`_of_bristles` adds these).

        Local numbers of all unknowns: up to n.whole frames and displacements of both sides, up to
        n.all temperatures, then bristles; writes: row of each, -1 for none. i, j: corners of the
        first and of the second facets; D: their coordinates that move (rows of tangent.z before the
        heats). `by_unknowns` needs only i: positions are in the second body's axes, in which its
        own corners move with their displacements alone.
        """
        k, n = now.kinematics, now.kinematics.sizes
        warms = bool((self.writes[n.whole :] >= 0).any())
        tangent = Tangent.from_overlaps(
            now.overlaps, now.pieces, self.face, now.loads, now.T, deforms=self.deforms,
            warms=warms)
        i, j, D = now.nodes[:, : n.d], now.nodes[:, n.d :] - n.n1, tangent.z.shape[2]
        # of nodal forces and heats by unknowns; then also forces by their transposed derivatives
        inner = k.by_unknowns(tangent.z, i) + k.by_rates(tangent.rate, i, j, c1[: n.whole])
        P, m, f = len(i), inner.shape[2], n.frames
        w = m + 2 * n.d
        size = w + (0 if now.sliding is None else n.d**2)
        made = np.zeros((P, size, size))
        made[:, :m, :m] = k.by_unknowns(inner[:, :D].transpose(0, 2, 1), i).transpose(0, 2, 1)
        made[:, m:w, :m], made[:, m:w, m:w] = inner[:, D:], tangent.T
        forces = summed(now.loads.force[:, : n.d], now.pieces.overlap, P)
        # own (P, d^2, f): rows of the first facet's displacements by frames, for constant forces
        frames, own = k.rows_by(forces, i)
        made[0, :f, :f] += frames
        if n.u1:
            made[:, f : f + n.d**2, :f] += own
            made[:, :f, f : f + n.d**2] += own.transpose(0, 2, 1)
        if self.bristles is not None and now.sliding is not None:
            contact = now.overlaps, now.pieces, self.face
            forces, heats = self.bristles.effect(*contact, c1[n.all + self.bristles.numbers(i)])
            made[:, :m, w:] = k.by_unknowns(forces.transpose(0, 2, 1), i).transpose(0, 2, 1)
            made[:, m:w, w:] = heats
            by_z, by_rate = self.bristles.by_corners(*contact, i, now.sliding, self.deforms)
            made[:, w:, :m] = k.by_unknowns(by_z, i) + k.by_rates(by_rate, i, j, c1[: n.whole])
        return made

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Error if a step of about h (s) that ends at t has moved a point through the other
        surface; "" otherwise. reach: largest admissible penetration, half the smallest facet, m."""
        first, second = (s.surface for s in self.sides)
        here = self._kinematics(x, v, t)
        depth = 0.0 if here is None else too_deep(first, second, here, h, self.reach, self.near)
        if depth == 0.0:
            return ""
        return (f"contact {self.source}: a point of {first.body.name} went {depth:.2g} m below the "
                f"surface of {second.body.name}, more than half the smallest facet "
                f"({self.reach:.2g} m): the step is too long for this contact, or its foundation "
                "too soft")

    @property
    def rejects(self) -> bool:
        return True

    @property
    def hides_resultants(self) -> bool:
        return not self._whole

    @property
    def histories(self) -> tuple[str, ...]:
        """Names of the recorded resultants; empty where facets are left out."""
        return names_of(self.sides[0].surface.d) if self._whole else ()

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        """Resultants at an accepted state x, v and time t (s), by the names in `histories`."""
        now = self._evaluate(x, v, t)
        assert now is not None
        found = resultants(1, np.zeros(len(now.nodes), np.int64), now.overlaps, now.pieces,
                           now.loads, self.face)
        return {name: float(value[0]) for name, value in found.items()}

    # ------------------------------------------------------------------ reduction

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal | FollowedContact:
        """Projected term, with a Verlet list where deformed surfaces have to be searched."""
        local = CompressedLocal.of(self, trial, left)
        return FollowedContact.from_contact(local) if self.deforms and local.elements else local

    def restrict(self, keep: IntArray) -> Self:
        """Term with the rows `keep` (positions in `rows`) only, the facets that contribute to them
        (active) and the columns they need. reads, writes: column and row of each local unknown, -1
        for none; hot: nodes of each surface with a kept row."""
        writes = renumbered(self.writes, keep, len(self.rows))
        n = Sizes.from_sides(*self.sides)
        active = self.active
        # every pair of facets acts on the frames and on the bristles' normal force
        if not (writes[: n.frames] >= 0).any() and not (writes[n.all :] >= 0).any():
            first, second = (a & hot[s.surface.facets].any(axis=1) for a, s, hot in zip(
                self.active, self.sides, n.touched(writes), strict=True))
            active = (first, second)
        read = self._read(active) & (self.reads >= 0)
        used = np.unique(self.reads[read])
        return replace(self, rows=self.rows[keep], columns=self.columns[used], writes=writes,
                       reads=renumbered(self.reads, used, len(self.columns)), active=active)

    def _read(self, active: tuple[BoolArray, BoolArray]) -> BoolArray:
        """True for each local unknown, temperature and deflection on which the active facets (masks
        of both surfaces; a pair is evaluated if one of its facets is active) depend: all of them,
        but of a surface's temperatures, from n.whole on, only those of its active facets, if no
        facet of the other surface is active."""
        n = Sizes.from_sides(*self.sides)
        if not (active[0].any() or active[1].any()):
            return np.zeros(len(self.reads), bool)
        read = np.ones(len(self.reads), bool)
        start = n.whole
        for side, mine, other in ((0, *active), (1, *active[::-1])):
            surface = self.sides[side].surface
            count = len(surface.nodes)
            if not other.any():  # else its partners may be anywhere
                near = np.zeros(count, bool)
                near[surface.facets[mine]] = True
                read[start : start + count] = near
            start += count
        return read

    # ------------------------------------------------------------------ for a Verlet list

    @property
    def movers(self) -> tuple[Mover, Mover]:
        """Both surfaces for the Verlet list: reference positions and columns of their unknowns."""
        n = Sizes.from_sides(*self.sides)
        ends = np.cumsum([0, n.f1, n.f2, n.u1, n.u2])
        columns = [self.reads[i:j] for i, j in pairwise(ends)]
        first, second = (
            Mover(s.surface.X, s.surface.facets, frame,
                  u.reshape(-1, n.d) if len(u) else np.full(s.surface.X.shape, -1))
            for s, frame, u in zip(self.sides, columns[:2], columns[2:], strict=True))
        return first, second

    def points(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray] | None:
        """Node positions (n1, d), (n2, d), m, in the second body's axes; None if not finite."""
        here = self._kinematics(x, 0.0 * x, t)
        return None if here is None else (here.a, here.b)

    def among(self, first: IntArray, second: IntArray) -> tuple[Self, IntArray, IntArray]:
        """The contact between the facets `first` and `second` (numbers) of the two surfaces alone,
        for a Verlet list (verlet_list.py), and the positions of its columns and rows in this term.
        used1, used2: their nodes; mine:
        their local unknowns, and all bristles; reads, writes: columns and rows of these, -1 for
        none."""
        n = Sizes.from_sides(*self.sides)
        (one, used1), (two, used2) = (s.some(chosen) for s, chosen in zip(
            self.sides, (first, second), strict=True))
        mine = np.concatenate([n.of_points(used1, used2), np.arange(n.all, len(self.reads))])
        reads, writes = self.reads[mine], self.writes[mine]
        columns, rows = np.unique(reads[reads >= 0]), np.unique(writes[writes >= 0])
        made = replace(
            self, rows=self.rows[rows], columns=self.columns[columns], sides=(one, two),
            reads=found_in(reads, columns), writes=found_in(writes, rows),
            active=(self.active[0][first], self.active[1][second]),
            bristles=self.bristles and replace(self.bristles, patch=self.bristles.patch[used1]))
        return made, columns, rows
