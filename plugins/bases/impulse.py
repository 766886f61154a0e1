"""Impulse responses of one body to unit loads along the path of a moving load."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field, field_validator, model_validator

from sparsemor.core import Basis, BlockData, Dictionary, FloatArray, InputError
from sparsemor.core.linalg.dense import oriented_unit_columns
from sparsemor.core.model.model import distinct_names
from sparsemor.plugins.bases.load_patterns import (
    compressed,
    known_step,
    moving_loads,
    refuse_both,
    refuse_nowhere,
    steps_of,
)
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.static_response import factorize, is_thermal


def tabled_responses(data: BlockData) -> FloatArray:
    """Responses (n, N) of a block at rest to its load tables, at their N steps h, 2 h, ...

    Implicit Euler: (K + D/h + M/h^2) x_n = f_n + D x_(n-1)/h + M (2 x_(n-1) - x_(n-2))/h^2, with
    damping D, for displacements; (K_T + C/h) x_n = f_n + C x_(n-1)/h for temperatures. f_n: loads
    of the tables; for displacements also those of the temperatures that the tables cause.
    """
    h, n = data.step, data.size
    X = np.zeros((n, steps_of(data)))
    if not is_thermal(data) and data.heat is not None and data.coupling is not None and (
            data.heat.moving):
        X = np.asarray(data.coupling @ tabled_responses(data.heat))
    for load in data.moving:
        times = load.table.times[0] + h * np.arange(1, X.shape[1] + 1)
        X += load.columns @ load.table.along(times).T
    # factors of x_(n-1) and x_(n-2)
    if is_thermal(data):
        last, before = data.mass / h, None
    else:
        before = data.mass / -h**2
        last = -2.0 * before if data.damping is None else data.damping / h - 2.0 * before
    operator = data.stiffness + last
    factor = factorize(operator if before is None else operator + before, data)
    x = older = np.zeros(n)
    for j in range(X.shape[1]):
        f = X[:, j] + last @ x
        if before is not None:
            f += before @ older
        x, older = factor.solve(f), x
        X[:, j] = x
    return X


REST = 1e-7
"""Norm of the part of superposed responses that may be left out, relative to their largest singular
value."""


class Impulse(Basis):
    """Thermal impulse responses: (B^-1 c1 C)^p B^-1 g, p steps after unit heat g on a path point.

    B = K_T + c1 C is the operator of an implicit time step, with conductivity K_T and capacity C.
    Temperatures under a moving heat source are sums of these responses over all positions and
    delays p, so no training run is needed. For displacements, the same holds with the operator D of
    their step for B, and D - K for c1 C.
    """

    positions: int | None = Field(default=None, ge=1)
    """Number of unit loads along the path of each moving load (hat functions where the body is
    planar); left out: one per node."""
    tabled: int | None = Field(default=None, ge=1)
    """Number of load shapes instead of unit loads: the leading singular vectors of each load table
    (amplitudes of the load's nodes over time). For loads that cover many nodes at once."""
    delays: tuple[int, ...] | None = Field(default=None, min_length=1)
    """Numbers of steps p, increasing. Left out: 0, 1, 2, 4, ... and the length of the load's table,
    because a body stores heat for the whole run."""
    substeps: int | None = Field(default=None, ge=1)
    """Largest number of steps from one delay to the next; where delays are further apart, the steps
    are longer: nearly the same temperatures at a fraction of the cost. Left out: the steps of the
    run."""
    superposed: bool = False
    """Superpose the responses with the amplitudes of the load tables (Duhamel's sum): the block's
    response to all its tables, one solve per step, for displacements also to the temperatures that
    the tables cause. Fewer atoms at the same error, but for these tables alone."""
    count: int | None = Field(default=None, ge=1)
    """Number of orthonormal atoms to which the responses are compressed by singular value
    decomposition, in addition to the uniform temperature and the initial values; each response is
    weighted by the interval of delays that it represents. Left out: the responses themselves."""
    rank_rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Tolerance of linear dependence: a response is left out when its part outside the span of
    earlier ones is below this (2-norm, relative); with `count`, a direction is left out when its
    singular value is below this share of the largest."""

    @field_validator("delays")
    @classmethod
    def _increasing(cls, delays: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if delays is not None and (delays[0] < 0 or np.any(np.diff(delays) <= 0)):
            raise ValueError("numbers of steps must increase, from 0 on")
        return delays

    @model_validator(mode="after")
    def _one_kind(self) -> "Impulse":
        refuse_both(self.positions, self.tabled, "positions")
        for name, value in (("positions", self.positions), ("tabled", self.tabled),
                            ("delays", self.delays), ("substeps", self.substeps)):
            if self.superposed and value is not None:
                raise InputError("superposed: true takes the response to the load tables, which "
                                 f"{name} does not change: leave it out", name)
        return self

    @property
    def needs_snapshots(self) -> bool:
        return False

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.count is None else min(size, self.count + 2)

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these responses (no load moves over it); "" if it can."""
        return "" if self._acts(data) else str(refuse_nowhere(data, "impulse"))

    def _acts(self, data: BlockData) -> bool:
        """True if a load moves over the block or, for `superposed`, heats it."""
        heated = self.superposed and data.heat is not None and data.coupling is not None
        return bool(data.moving or heated and data.heat is not None and data.heat.moving)

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError if no load moves or the time step is
        unknown."""
        if self.superposed:
            return self._superposed(data)
        forces, names = moving_loads(data, self.positions, self.tabled)
        if not names:
            raise refuse_nowhere(data, "impulse")
        known_step(data, "impulse")
        # kept beside all responses: uniform temperature and initial values
        first, first_names = _lasting(data)
        delays = np.array(self.delays or _doubling(data))
        responses = list(_responses(data, forces, delays, self.substeps))
        if self.count is None:
            said = [f"impulse {name}, delay {p}" for p in delays for name in names]
            found = oriented_unit_columns(np.concatenate([first, *responses], axis=1))
            kept, _ = independent(found, self.rank_rtol)
            atoms, provenance = found[:, kept], [[*first_names, *said][i] for i in kept]
        else:
            # sum of x x^T over all delays: covariance of temperatures x under unit heat at random
            # times and positions; the computed delays are the nodes of a quadrature of this sum
            gaps = np.gradient(delays.astype(float)) if len(delays) > 1 else np.ones(1)
            A = np.concatenate(
                [np.sqrt(g) * x for g, x in zip(gaps, responses, strict=True)], axis=1)
            atoms, provenance = compressed(
                first, first_names, A, self.count, self.rank_rtol, "impulse mode")
        names_of_atoms = tuple(distinct_names(provenance))
        return Dictionary(oriented_unit_columns(atoms), np.zeros(data.size), names_of_atoms, {
            "positions": len(names), "delays": ", ".join(map(str, delays)),
            "responses": len(names) * len(delays), "kept": atoms.shape[1]})

    def _superposed(self, data: BlockData) -> Dictionary:
        """Orthonormal atoms of the response to the load tables, its leading directions but for
        the share `REST` of it."""
        if not self._acts(data):
            raise refuse_nowhere(data, "impulse")
        known_step(data, "impulse")
        first, names = _lasting(data)
        X = tabled_responses(data)
        atoms, said = compressed(
            first, names, X, self.count or min(X.shape), self.rank_rtol, "response", REST)
        if len(said) == len(names):  # all tables are 0
            raise refuse_nowhere(data, "impulse")
        return Dictionary(oriented_unit_columns(atoms), np.zeros(data.size), tuple(said),
                          {"responses": X.shape[1], "kept": len(said)})


def _lasting(data: BlockData) -> tuple[FloatArray, list[str]]:
    """Atoms that the basis has before the impulse responses, which then need not represent them:
    unit columns (n, 0 to 2) and their names, the uniform temperature and the initial values."""
    columns, names = [np.zeros((data.size, 0))], []
    if is_thermal(data):
        columns.append(np.full((data.size, 1), data.size**-0.5))
        names.append("uniform")
    if data.start.any():
        columns.append(data.start[:, None] / np.linalg.norm(data.start))
        names.append("start")
    found = np.concatenate(columns, axis=1)
    kept, _ = independent(found, 1e-10)
    return found[:, kept], [names[i] for i in kept]


def _doubling(data: BlockData) -> list[int]:
    """Delays 0, 1, 2, 4, ... steps, up to the number of steps that the load tables cover."""
    last = steps_of(data)
    return [0, *(2**i for i in range(last.bit_length()) if 2**i < last), last]


def _responses(
    data: BlockData, forces: FloatArray, delays: FloatArray, substeps: int | None
) -> Iterator[FloatArray]:
    """Responses (n, q) of unit loads (n, q) at each of the increasing delays, in steps of the run,
    by time stepping: one solve of all q columns per step. substeps: most steps from one delay to
    the next, which are longer then; None: those of the run.

        B x_0 = f,    B x_p = (B - K) x_(p-1),    B: operator of a step, K: stiffness (or K_T)
    """
    first, carried = factorize(data.operator, data), data.operator - data.stiffness
    x, last = np.asarray(first.solve(np.ascontiguousarray(forces))), 0
    for p in delays.tolist():
        steps = p - last if substeps is None else min(p - last, substeps)
        factor, passed = first, carried
        if 0 < steps < p - last:  # each of them as long as several, so that c1 C is smaller
            passed = carried * (steps / (p - last))
            factor = factorize(data.stiffness + passed, data)
        for _ in range(steps):
            x = np.asarray(factor.solve(np.ascontiguousarray(passed @ x)))
        yield x
        last = p
