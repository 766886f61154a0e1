"""Sparse projection-free reducer: coefficients of few atoms from sampled rows of the full-order
equations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from sparsemor.core import (
    AssembledModel,
    BlockBases,
    BlockBudget,
    Dictionary,
    Fault,
    FloatArray,
    InputError,
    IntArray,
    Note,
    OfflineProducts,
    ReducedProblem,
    StepFactors,
    StepSolver,
)
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.reducers.checks import (
    block_size,
    budget_faults,
    capability_faults,
    coupled_faults,
    local_blocks,
    pattern_faults,
    preconditioner_faults,
    required_rows,
    resampling_faults,
)
from sparsemor.reducers.field_options import BASES, counted, of_field
from sparsemor.reducers.notes import (
    shadowed_basis,
    unread_sampler,
    unselected,
    unweighted,
)
from sparsemor.reducers.projection.ecsw.element_weights import WeightTraining
from sparsemor.reducers.sparse.build import Build, Whole
from sparsemor.reducers.sparse.options import Budget, SparseOptions
from sparsemor.reducers.sparse.resampling import Resampled, Streams, branched
from sparsemor.reducers.sparse.residual_rows import (
    inverted_blocks,
    own_terms,
    plain_rows,
    samplers,
    unweighed,
)
from sparsemor.reducers.sparse.sampled_block import CompressedRows, choose_rows, effect_of_rows
from sparsemor.reducers.step.prepare import constants
from sparsemor.reducers.trial_bases import spanned, trial_bases


class Sparse(SparseOptions):
    """Sparse projection-free reduction: few coefficients recovered from sampled rows (Eq. 25).

    Where a budget is at least the size of the dictionary, all atoms are active and none are
    selected.
    """

    shared_options: ClassVar[tuple[str, ...]] = (*BASES, "budgets")

    @property
    def keeps_joint_rows(self) -> bool:
        return True

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes of the step solvers of a kept model."""
        from sparsemor.reducers.stored_classes import CLASSES

        return CLASSES

    def field_budget(self, field: str) -> BlockBudget | None:
        found = of_field(field, self.budgets)
        return None if found is None else BlockBudget(found.rows, found.atoms)

    def active_atoms(self, name: str, atoms: int) -> int:
        return min(matched_option(name, self.budgets, Budget()).atoms or atoms, atoms)

    def with_rows(self, rows: Mapping[str, int]) -> "Sparse":
        return self.model_copy(update={"budgets": self._varied("rows", rows)})

    def with_atoms(self, atoms: Mapping[str, int]) -> "Sparse":
        basis, bases = counted(atoms, self.basis, self.bases)
        return self.model_copy(update={
            "budgets": self._varied("atoms", atoms), "basis": basis, "bases": bases})

    def _varied(self, option: str, counts: Mapping[str, int]) -> dict[str, Budget]:
        """Budgets by field with another number of rows or atoms each; they are validated with the
        scene."""
        return {f"*.{field}": (of_field(field, self.budgets) or Budget()).model_copy(
            update={option: n}) for field, n in counts.items()}

    def trial_bases(self) -> BlockBases:
        return BlockBases(self.basis, self.bases)

    def restart_refusal(self) -> str:
        return "" if self.resample is None else (
            "the rows of this reducer change with the steps, so steps of different size cannot be "
            "compared: keep its rows (leave out reducer.resample), or leave out time.control")

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        model, h, offline = problem.model, problem.step, problem.offline
        faults = self.check(model)
        if faults:
            raise InputError(faults).under("reducer")
        budgets = {n: matched_option(n, self.budgets, Budget()) for n in model.reducible()}
        step = StepFactors(h, *constants(problem.integrator, h))
        bases = trial_bases(offline, model, self, step)
        sizes = {n: d.atoms.shape[1] for n, d in bases.dictionaries.items()}
        dictionaries, limits, unfit = spanned(bases, offline, {
            n for n, k in sizes.items() if (budgets[n].atoms or k) >= k})
        streams = dict(zip(budgets, problem.rng.spawn(len(budgets)), strict=True))
        inverted, drawn = inverted_blocks(model, self), samplers(model, self)
        sampled = [n for n in budgets if n not in inverted or self.samples(n)]
        counts = {n: budgets[n].rows for n in sampled}

        def draw(streams: Streams, keep: OfflineProducts | None) -> dict[str, IntArray]:
            return {n: choose_rows(
                model, keep, n, counts[n], budgets[n].atoms or 10**9, drawn[n], dictionaries[n],
                streams[n], step, n in inverted) for n in sampled}

        heat = {b.thermal for b in model.separated.heat}
        later = {n: rng.spawn(1)[0] for n, rng in streams.items()}
        rows = draw(streams, offline)
        counts = {n: len(r) - required_rows(model, n, drawn[n]) for n, r in rows.items()}
        local, atoms = own_terms(model), {n: d.atoms for n, d in dictionaries.items()}
        compressed = {n: CompressedRows.of(
            model, offline, n, step, atoms[n], n in local and n not in heat)
            for n in sorted(inverted) if n not in rows}
        effects = {n: effect_of_rows(model, offline, n, step, atoms[n], rows[n])
                   if n in rows else compressed[n].left for n in local if n in inverted}
        weighed, weights = self._weighed(problem, dictionaries, effects)
        build = Build(
            weighed, offline, self, dictionaries, limits,
            {n: b.atoms for n, b in budgets.items()}, step, inverted, compressed,
            (*unfit, *self._idle(model, dictionaries, rows), *weights.notes()), weights.facts)
        if self.resample is None:
            return build.solver(rows)
        return self._resampled(build, rows, later, draw)

    def _weighed(
        self, problem: ReducedProblem, dictionaries: Mapping[str, Dictionary],
        effects: Mapping[str, FloatArray]
    ) -> tuple[AssembledModel, WeightTraining]:
        """The model with element weights in the local terms of some blocks, and their training;
        effects (k, n): of forces on all rows of such a block on its coefficients."""
        model, s = problem.model, problem.model.separated
        training = WeightTraining(model, problem.offline, problem.step, self.tau, dictionaries,
                                  effects.__getitem__)
        heat = tuple(training.heat(b) if b.thermal in effects else b for b in s.heat)
        moving = tuple(training.elastic(m) if m.elastic in effects else m for m in s.moving)
        return model.with_separated(replace(s, heat=heat, moving=moving)), training

    def _idle(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
        rows: Mapping[str, IntArray]
    ) -> tuple[Note, ...]:
        """Notes on options that have no effect in this run."""
        atoms = {n: d.atoms.shape[1] for n, d in dictionaries.items()}
        active = {n: (matched_option(n, self.budgets, Budget()).atoms or k, k)
                  for n, k in atoms.items()}
        return (
            *plain_rows(model, self), *unselected(self, active),
            *shadowed_basis(self, model, self.bases),
            *unread_sampler(self, {n: (len(r), block_size(model, n)) for n, r in rows.items()}),
            *unweighted(self, model, self.preconditioned))

    def _resampled(
        self, build: Build, rows: Mapping[str, IntArray], later: Streams,
        draw: Callable[[Streams, OfflineProducts | None], Mapping[str, IntArray]],
    ) -> StepSolver:
        """Step solver with resampling, which begins with the rows of a run without resampling;
        later: random streams of the further draws."""
        assert self.resample is not None
        whole = Whole.of(build.model, build.dictionaries)
        first = build.solver(rows, whole)
        if self.row_sets is None:
            online = replace(build, offline=None)

            def fresh(rows: Mapping[str, IntArray], number: int) -> StepSolver:
                return online.solver(rows, whole, number)

            return Resampled(
                first, (first,), self.resample, lambda s: draw(s, None), fresh, later)
        others = [build.solver(draw(branched(later), build.offline), whole, i)
                  for i in range(1, self.row_sets)]
        return Resampled(first, (first, *others), self.resample, None, None, {})

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options found by counting, before any training; keys relative to the
        reducer."""
        faults = budget_faults(model, self.budgets, self.sampler)
        faults += pattern_faults(model, "bases", self.bases)
        faults += pattern_faults(model, "preconditioned", self.preconditioned)
        faults += preconditioner_faults(
            model, self.budgets, self.sampler, self.preconditioner, self.preconditioned,
            self.basis, self.bases)
        faults += capability_faults(
            model, self.budgets, self.sampler, self.solver, self.basis, self.bases,
            self.selection == "joint",
            {n for n in inverted_blocks(model, self) if not self.samples(n)})
        faults += resampling_faults(model, self.resample, self.row_sets)
        faults += self._residual_faults(model)
        if not isinstance(self.carried, bool):
            faults += pattern_faults(model, "carried", self.carried)
            if self.polish:
                faults.append(Fault("carried", "selections in a step that is solved again start "
                                    "together: take true or false, or polish: false"))
        faults += coupled_faults(model, self.budgets, self.basis, self.bases, self.resample)
        if not self.polish and self.every > 1:
            faults.append(Fault("every", "without polish each step needs its own selection: "
                                "take every: 1"))
        if not self.polish and self.selection != "joint":
            faults.append(Fault("selection", "without polish the solution of the problem of all "
                                "blocks is used: take selection: joint"))
        local = [b.thermal for b in model.separated.heat if b.local]
        if not self.polish and local:
            faults.append(Fault("polish", f"the selection in {', '.join(local)} is linear and "
                                "leaves radiation to the polish: take polish: true"))
        return faults

    def _residual_faults(self, model: AssembledModel) -> list[Fault]:
        """Faults of sampling D^-1 r where a step, or a draw of rows, would need operations with the
        whole mesh."""
        faults = ([] if isinstance(self.residual, str) else
                  pattern_faults(model, "residual", self.residual))
        inverted = [n for n in model.reducible() if self.residual_of(n) == "preconditioned"]
        local, whole = local_blocks(model), unweighed(model, self)
        for name in inverted:
            if name in whole:
                faults.append(Fault("residual", (
                    f"a row of D^-1 r reads all of r in {name}, and so every element of "
                    f"{local[name]} in each step, because {whole[name].format(local[name])}: take "
                    "plain rows there (auto does), or a reducer that evaluates all of them, such "
                    "as galerkin")))
        if inverted and self.resample is not None and self.row_sets is None:
            faults.append(Fault("row_sets", (
                f"each draw of rows of D^-1 r in {', '.join(inverted)} takes solves with the whole "
                "operator: give a number of row sets, which are prepared in advance")))
        return faults
