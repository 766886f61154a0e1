"""Attachment modes of moving loads: static responses of one body to unit loads along their path."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import Basis, BlockData, Dictionary, FloatArray, InputError, Slot
from sparsemor.core.linalg.dense import unit_columns
from sparsemor.core.model.model import distinct_names
from sparsemor.plugins.bases.load_patterns import (
    compressed,
    known_step,
    likely_states,
    moving_loads,
    refuse_both,
    refuse_nowhere,
)
from sparsemor.plugins.bases.orthogonalise import independent_atoms
from sparsemor.plugins.bases.static_response import StaticSolver, factorize


class Attachment(Basis):
    """Attachment modes of moving loads: K^-1 f for unit loads f along their path.

    With `thermal`, also the thermoelastic displacements K^-1 K_fT T for basis vectors T of the
    temperatures. Quasi-static displacements are combinations of these for every load history, so no
    training run is needed: the coefficients are the load amplitudes and the thermal coefficients.
    For an insulated body, whose conductivity K is singular, the responses are those of `static`,
    and the uniform temperature is added.
    """

    patches: int | None = Field(default=None, ge=1)
    """Number of unit loads per direction along the path of each moving load (hat functions where
    the body is planar); left out: one per node."""
    tabled: int | None = Field(default=None, ge=1)
    """Number of load shapes instead of unit loads: the leading singular vectors of each load table
    (amplitudes of the load's nodes over time). For loads that cover many nodes at once."""
    thermal: Annotated[Basis, Slot("basis")] | None = None
    """Basis of the body's temperatures (the one of its thermal block): the displacements K^-1 K_fT
    T of each of its vectors T are added. Left out: none are added."""
    dynamic: bool = False
    """Add the responses D^-1 f to the same loads f, with the operator D of a time step (K + c1 D_m
    + c2 M, or K_T + c1 C), which contain the inertia of the first steps after a change of load."""
    count: int | None = Field(default=None, ge=1)
    """Number of orthonormal atoms to which the responses are compressed by singular value
    decomposition, in addition to the uniform temperature and the initial values. Mechanical and
    thermal responses are scaled to equal norm; each thermal state is weighted by its size under
    unit heat along the path. Left out: the responses themselves, whose coefficients are the
    loads."""
    rank_rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Tolerance of linear dependence: a response is left out when its part outside the span of
    earlier ones is below this (2-norm, relative)."""
    orthonormal: bool = False
    """Orthogonalise each response against the earlier ones: the same span, well conditioned, for
    reducers that use all atoms, such as `galerkin`."""

    @model_validator(mode="after")
    def _one_kind(self) -> "Attachment":
        refuse_both(self.patches, self.tabled, "patches")
        return self

    @property
    def needs_snapshots(self) -> bool:
        return self.thermal is not None and self.thermal.needs_snapshots

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.count is None else min(size, self.count + 2)

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these responses (no moving load and no temperature acts on
        it); "" if it can."""
        acts = data.moving or (self.thermal is not None and data.coupling is not None)
        return "" if acts else str(refuse_nowhere(data, "attachment"))

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k): static responses to the loads, with `dynamic` also those of
        the matrix of one time step (data.operator). Raises InputError if no load moves and no
        temperature acts, or if `dynamic` is set and the time step is unknown."""
        # families: mechanical and thermal loads (n, q) with the names of their responses
        families = [f for f in self._forces(data) if f[1]]
        if not families:
            raise refuse_nowhere(data, "attachment")
        solve = StaticSolver.from_data(data)
        answers, said = [solve(forces) for forces, _ in families], [n for _, n in families]
        if self.dynamic:
            known_step(data, "attachment with dynamic: true")
            factor = factorize(data.operator, data)
            for forces, names in families:
                answers.append(np.asarray(factor.solve(np.ascontiguousarray(forces))))
                said.append([f"dynamic {name}" for name in names])
        # uniform temperature and initial values: atoms whatever the others are compressed to
        lasting, lasting_names = [np.zeros((data.size, 0))], list[str]()
        if solve.uniform is not None:
            lasting.append(solve.uniform[:, None])
            lasting_names.append("uniform")
        if data.start.any():
            lasting.append(data.start[:, None])
            lasting_names.append("start")
        if self.count is not None:
            # one size for all families: newtons and kelvins do not compare
            level = [a / max(float(np.linalg.norm(a)), 1e-300) for a in answers]
            atoms, provenance = compressed(
                unit_columns(np.concatenate(lasting, axis=1)), lasting_names,
                np.concatenate(level, axis=1), self.count, self.rank_rtol, "attachment mode")
            return self._independent(data, atoms, provenance)
        return self._independent(
            data, np.concatenate([*lasting, *answers], axis=1), sum(said, lasting_names))

    def _independent(
        self, data: BlockData, found: FloatArray, said: list[str]
    ) -> Dictionary:
        """Dictionary of the columns of `found` (n, q) that are linearly independent of earlier
        ones; said: their names."""
        if not np.isfinite(found).all():
            raise InputError(f"attachment: the responses of {data.name} are not finite: its "
                             "stiffness is nearly singular")
        atoms, kept = independent_atoms(found, self.rank_rtol, self.orthonormal)
        return Dictionary(
            atoms, np.zeros(data.size), tuple(distinct_names([said[i] for i in kept])),
            {"responses": len(kept), "dependent": found.shape[1] - len(kept)})

    def _forces(self, data: BlockData) -> list[tuple[FloatArray, list[str]]]:
        """Right-hand sides (n, q) and names of their responses: mechanical loads, then thermal
        loads K_fT T = data.coupling @ T for temperatures T of a basis."""
        forces, names = moving_loads(data, self.patches, self.tabled)
        found = [(forces, [f"attachment {name}" for name in names])]
        if self.thermal is None or data.heat is None or data.coupling is None:
            return found
        heat = self.thermal.build(data.heat)
        moved = [heat.offset[:, None]] if heat.offset.any() else []
        temperatures = np.concatenate([*moved, heat.atoms], axis=1)
        said = [f"thermoelastic {p}" for p in (*["offset"] * len(moved), *heat.provenance)]
        if self.count is not None:
            temperatures = likely_states(data.heat, temperatures, self.tabled)
            said = [f"thermoelastic {i}" for i in range(temperatures.shape[1])]
        return [*found, (np.asarray(data.coupling @ temperatures), said)]
