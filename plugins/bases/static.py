"""Static responses of one body to the loads of the scene, without a training run."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sparsemor.core import Basis, BlockData, Dictionary, FloatArray, InputError, Slot
from sparsemor.core.linalg.dense import oriented_unit_columns, unit_columns
from sparsemor.plugins.bases.load_patterns import compressed, known_step, load_names
from sparsemor.plugins.bases.orthogonalise import independent_atoms
from sparsemor.plugins.bases.static_response import StaticSolver, factorize, is_thermal

Rates = Annotated[tuple[Annotated[float, Field(ge=0.0)], ...], Field(min_length=1)]
Count = Annotated[int, Field(ge=1)]


LASTING = ("static uniform", "start")
"""Responses that are atoms whatever the others are compressed to."""


class Static(Basis):
    """Static modes: K^-1 f for each load, weight, inertia and joint force f, K^-1 K_fT T for heat.

    Quasi-static displacements are combinations of these; T are basis vectors of the temperatures.
    Temperatures under heat loads are computed at the rates `rates`, which is a rational Krylov
    space of the body's heat equation (moment matching): for any heat over time, no training run.
    The uniform temperature is added for an insulated body, and the initial values for every body.
    """

    thermoelastic: bool = True
    """Add the displacements K^-1 K_fT T for each vector T of a basis of the body's temperatures."""
    thermal: Annotated[Basis, Slot("basis")] | None = None
    """Basis of the temperatures T (the one of the body's thermal block). Left out: `static` with
    the same rates."""
    rates: Rates | Count = (0.0,)
    """Rates s, 1/s, of the temperatures (K_T + s C)^-1 f under heat f: 0 gives the steady state,
    1/h the first step of implicit Euler with step h. Or their number, 1 at least: they are then 0
    and a geometric sequence from the slowest rate of the steady responses to that of a time step.
    Displacements are computed at 0 only."""
    count: Count | None = None
    """Number of orthonormal atoms to which the responses are compressed, all of unit length, by
    singular value decomposition, in addition to the uniform temperature and the initial values.
    Left out: the responses themselves."""
    rank_rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Tolerance of linear dependence: a response is left out when its part outside the span of
    earlier ones is below this (2-norm, relative); with `count`, a direction is left out when its
    singular value is below this share of the largest."""
    orthonormal: bool = False
    """Orthogonalise each response against the earlier ones: the same span, well conditioned, for
    `galerkin` with many rates. Otherwise the coefficients are the load amplitudes."""

    @property
    def needs_snapshots(self) -> bool:
        return False

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.count is None else min(size, self.count + 2)

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these responses (the basis of its temperatures needs
        snapshots); "" if it can."""
        return self._snapshots_needed(data) if self._thermoelastic(data) else ""

    def _thermoelastic(self, data: BlockData) -> bool:
        return not is_thermal(data) and self.thermoelastic and (
            data.heat is not None and data.coupling is not None)

    def _snapshots_needed(self, data: BlockData) -> str:
        return "" if self.thermal is None or not self.thermal.needs_snapshots else (
            f"the thermoelastic responses of {data.name} are made without training, and `thermal` "
            "names a basis that needs snapshots: use modal or static there")

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError when nothing loads the block."""
        columns, names = self._of_heat(data) if is_thermal(data) else self._of_forces(data)
        found = np.concatenate(columns, axis=1) if columns else np.zeros((data.size, 0))
        if not found.any():
            raise InputError(
                f"no load, joint or temperature acts on {data.name}, so there is no static "
                "response: give this block another basis under reducer.bases, such as modal")
        if self.count is not None:
            lasting = np.isin(names, LASTING)  # uniform temperature and initial values: always kept
            atoms, said = compressed(
                unit_columns(found[:, lasting]), [n for n in names if n in LASTING],
                unit_columns(found[:, ~lasting]), self.count, self.rank_rtol, "static mode")
            return Dictionary(oriented_unit_columns(atoms), np.zeros(data.size), tuple(said),
                              {"responses": found.shape[1], "kept": len(said)})
        atoms, kept = independent_atoms(found, self.rank_rtol, self.orthonormal)
        left_out = [names[i] for i in np.setdiff1d(np.flatnonzero(found.any(axis=0)), kept)]
        return Dictionary(
            atoms, np.zeros(data.size), tuple(names[i] for i in kept),
            {"responses": len(kept), "dependent": ", ".join(left_out) or "none"})

    def _of_forces(self, data: BlockData) -> tuple[list[FloatArray], list[str]]:
        """Responses, in blocks of columns (n, j), and a name for each column: of displacements to
        the loads, the initial values, and responses to the temperatures of a basis (forces
        K_fT T = data.coupling @ T)."""
        solve = StaticSolver.from_data(data)
        columns = [np.zeros((data.size, 0)) if solve.uniform is None else solve.uniform[:, None],
                   solve(data.loads)]
        names = [] if solve.uniform is None else [LASTING[0]]
        names += [f"static {load}" for load in load_names(data)]
        if data.start.any():
            columns.append(data.start[:, None])
            names.append(LASTING[1])
        if self.thermoelastic and data.heat is not None and data.coupling is not None:
            basis = self.thermal or Static(rates=self.rates)
            if self._snapshots_needed(data):
                raise InputError(self._snapshots_needed(data))
            heat = basis.build(data.heat)
            temperatures = np.column_stack([heat.offset, heat.atoms])
            columns.append(solve(np.asarray(data.coupling @ temperatures)))
            names += [f"thermoelastic {p}" for p in ("offset", *heat.provenance)]
        return columns, names

    def _of_heat(self, data: BlockData) -> tuple[list[FloatArray], list[str]]:
        """Responses, in blocks of columns (n, j), and a name for each column: of temperatures, the
        uniform one and the initial values, then (K_T + s C)^-1 f for the loads f at each rate s."""
        steady = StaticSolver.from_data(data)
        columns: list[FloatArray] = []
        names: list[str] = []
        if steady.uniform is not None:
            columns.append(steady.uniform[:, None])
            names.append(LASTING[0])
        if data.start.any():
            columns.append(data.start[:, None])
            names.append(LASTING[1])
        for rate in self._rates_of(data, steady):
            if rate == 0.0:
                columns.append(steady(data.loads))
            else:
                factor = factorize(data.stiffness + rate * data.mass, data)
                columns.append(np.asarray(factor.solve(np.ascontiguousarray(data.loads))))
            at = "" if rate == 0.0 else f" at {rate:g}/s"
            names += [f"static {load}{at}" for load in load_names(data)]
        return columns, names

    def _rates_of(self, data: BlockData, steady: StaticSolver) -> tuple[float, ...]:
        """The rates, 1/s; where `rates` is their number n: 0 and s_i = s_1 (s_h / s_1)^(i/(n - 2)),
        i = 0 ... n - 2, with s_h = c1 of a time step and s_1 = min x.K_T x / x.C x over the steady
        responses x. Rayleigh quotients of them are near the slowest decay that the loads excite."""
        if not isinstance(self.rates, int):
            return self.rates
        if self.rates == 1:
            return (0.0,)
        known_step(data, "static with a number of rates")
        X, fastest = steady(data.loads), data.factors[1]  # s_h, 1/s
        stored = np.einsum("ij,ij->j", X, data.mass @ X)
        decay = np.einsum("ij,ij->j", X, data.stiffness @ X)[stored > 0.0] / stored[stored > 0.0]
        slowest = min(decay.min(initial=fastest), fastest)
        return (0.0, *np.geomspace(slowest, fastest, self.rates - 1).tolist())
