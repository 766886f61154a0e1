"""Approximate Jacobian of a model whose blocks are linear and written in eigenmodes: diagonal
blocks, temperatures that load displacements, and a border of rigid coordinates and multipliers.

Terms between two modes of one block, which come from damping and from rotation and are small
against inertia in one step, are left out, and so is what the tangents of terms that are not linear
differ from those in the middle of training; the next step of the errors corrects them. Rigid
coordinates and multipliers are solved for by the Schur complement of the modes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.estimation.error_space import ErrorSpace
from sparsemor.reducers.step.jacobian_factors import Factor
from sparsemor.reducers.step.reduced_equations import Reduced


@dataclass(frozen=True, slots=True, eq=False)
class BodyModes:
    """Modes of one body in the Jacobian: their range `at`, that of its temperatures, and its rigid
    unknowns (n,). Its parts: diagonal (q,) of the modes by themselves, coupling (q, qT) with
    temperatures, column (q, n) of the modes by rigid unknowns, row (n, q) of these by the modes."""

    at: slice
    thermal: slice
    rigid: IntArray
    diagonal: FloatArray
    coupling: FloatArray
    column: FloatArray
    row: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class BorderedModes:
    """The factorized Jacobian; heat: range and diagonal of each thermal block; border: positions of
    rigid unknowns and multipliers; factor: of their Schur complement, None without any."""

    heat: tuple[tuple[slice, FloatArray], ...]
    bodies: tuple[BodyModes, ...]
    border: IntArray
    factor: Factor | None

    @classmethod
    def at_state(
        cls, equations: Reduced, spaces: Mapping[str, ErrorSpace], x: FloatArray, v: FloatArray,
        a: FloatArray, t: float, c1: float, c2: float, c1_first: float
    ) -> "BorderedModes":
        """The Jacobian at unknowns x with rates v and a (n,) at t, s, with dv = c1 dx, da = c2 dx
        (temperatures: c1_first). spaces: block -> the modes in which its equations are written.
        Raises RuntimeError where it is singular."""
        # S (N, N): Schur complement of the modes in the border; number: unknown -> number in it;
        # made (`BorderBlocks`): derivatives for one body, of its rigid and constraint rows by its
        # border unknowns `at` (corner) and modes (row), and of its modes by `at` (column)
        border = equations.border
        number = np.zeros(equations.layout.size, dtype=np.int64)
        number[border] = np.arange(len(border))
        S, bodies = np.zeros((len(border), len(border))), []
        for made in equations.border_blocks(x, v, a, t, c1, c2):
            body, at = made.body, np.ix_(number[made.at], number[made.at])
            S[at] += made.corner
            if (b := body.operators) is None:
                continue
            space = spaces[body.step.elastic_name]
            # K + c1 C + c2 M and the diagonal of the rotation sum_g (kappa_g + c1 mu_g) G_g
            diagonal = (space.stiffness + c1 * space.damping + c2 * space.mass
                        + made.turning[: len(b.generators)]
                        @ np.diagonal(b.generators, axis1=1, axis2=2))
            S[at] -= made.row @ (made.column / diagonal[:, None])
            bodies.append(BodyModes(
                at=body.step.elastic, thermal=body.step.thermal, rigid=made.at, diagonal=diagonal,
                coupling=b.coupling, column=made.column, row=made.row))
        if not len(border):  # all frames are prescribed
            none = np.zeros(0, dtype=np.int64)
            for body in equations.bodies:
                if (b := body.operators) is not None:
                    space = spaces[body.step.elastic_name]
                    diagonal = space.stiffness + c1 * space.damping + c2 * space.mass
                    bodies.append(BodyModes(
                        at=body.step.elastic, thermal=body.step.thermal, rigid=none,
                        diagonal=diagonal, coupling=b.coupling,
                        column=np.zeros((space.size, 0)), row=np.zeros((0, space.size))))
        heat = tuple((equations.layout[n], s.stiffness + c1_first * s.damping)
                     for n, s in spaces.items() if equations.layout.block(n).kind.order == 1)
        return cls(heat, tuple(bodies), border, equations.factorize(S) if len(border) else None)

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution (n,) for a right-hand side r (n,): heat, displacements without border, border,
        and what it changes in the displacements. With modes u and border unknowns y of each body,
        diagonal u - coupling T + column y = r_u, and row u adds to the rows of y. factor: that of
        the border's Schur complement, None where all frames are prescribed."""
        z, rest = np.zeros(len(r)), r.copy()
        for at, diagonal in self.heat:
            z[at] = r[at] / diagonal
        for b in self.bodies:
            load = r[b.at] + b.coupling @ z[b.thermal] if b.coupling.size else r[b.at]
            z[b.at] = load / b.diagonal
            rest[b.rigid] -= b.row @ z[b.at]
        if self.factor is not None:
            z[self.border] = self.factor.solve(rest[self.border])
            for b in self.bodies:
                z[b.at] -= b.column @ z[b.rigid] / b.diagonal
        return z
