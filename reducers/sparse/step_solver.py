"""Step solver of the reducer `sparse` from a model and its offline data: the sampled rows of each
block are drawn, and the solver is assembled from them."""

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sparsemor.core import (
    AssembledModel,
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
    information,
)
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.protocols.sparse_solver import solver_refusal
from sparsemor.reducers.block_counts import block_size, required_rows
from sparsemor.reducers.reducer_notes import (
    no_effect,
    shadowed_basis,
    unread_sampler,
    unsampled_loads,
    unselected,
    unweighted,
    worse_conditioned,
)
from sparsemor.reducers.sparse.oblique_projection import checked_rows, row_note
from sparsemor.reducers.sparse.option_faults import unselectable, unselectable_blocks
from sparsemor.reducers.sparse.resampling import Resampled, Streams, branched
from sparsemor.reducers.sparse.residual_rows import (
    inverted_blocks,
    own_terms,
    plain_rows,
    samplers,
)
from sparsemor.reducers.sparse.sampled_block import (
    CompressedRows,
    Sampled,
    SampledElastic,
    SampledHeat,
    choose_rows,
    effect_of_rows,
    inverse_rows,
    row_facts,
    weigh,
)
from sparsemor.reducers.sparse.sparse_options import Budget, SparseOptions
from sparsemor.reducers.sparse.supported_equations import (
    ActiveRows,
    SupportedEquations,
    SupportedMechanics,
)
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver, Facts, stepper
from sparsemor.reducers.step.compiled.compiled_stepper import compilable, no_effect_of
from sparsemor.reducers.step.coupled_reduced import (
    ProjectedBlock,
    ProjectedModel,
    ReducedGeneral,
    dense_equations,
    reduced_general,
)
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat, TestMap
from sparsemor.reducers.step.thermal_groups import heat_groups
from sparsemor.reducers.trial_bases import spanned, trial_bases


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """All rows of every block projected on its atoms, dense: the source of rows that change in the
    run."""

    heat: Mapping[str, ProjectedHeat]
    elastic: Mapping[str, ProjectedElastic]

    @classmethod
    def from_model(cls, model: AssembledModel, dictionaries: Mapping[str, Dictionary]) -> "Whole":
        """Projection of all rows; a row set is then taken from its (n, k) matrices."""
        heat = {b.thermal: ProjectedHeat.from_operators(b, dictionaries[b.thermal], TestMap())
                for b in model.separated.heat}
        elastic = {m.elastic: ProjectedElastic.from_operators(
            m.operators, m.frame, dictionaries[m.elastic], dictionaries.get(m.thermal), TestMap(),
            rigid=model.separated.rigid_equations)
            for m in model.separated.moving if m.operators is not None}
        return cls(heat, elastic)


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """Data from which a step solver is assembled for any set of sampled rows.

    atoms: largest number of active atoms of each block, None for the whole dictionary; step: step
    size and integrator constants; inverted: blocks whose rows are those of D^-1 r; compressed: all
    rows of D^-1 r of the blocks whose rows are not sampled; offline: cache, None for rows drawn
    during the run; notes: findings that do not depend on the rows; weights: facts of
    the element weights of each block's local terms.
    """

    model: AssembledModel
    offline: OfflineProducts | None
    options: SparseOptions
    dictionaries: Mapping[str, Dictionary]
    limits: Mapping[str, float]
    atoms: Mapping[str, int | None]
    step: StepFactors
    inverted: frozenset[str]
    compressed: Mapping[str, CompressedRows]
    notes: tuple[Note, ...] = ()
    weights: Facts = field(default_factory=dict)

    def solver(
        self, rows: Mapping[str, IntArray], whole: Whole | None = None, row_set: int = 0
    ) -> StepSolver:
        """Step solver that evaluates the sampled rows (m,) of each block in `rows`, and all rows of
        D^-1 r in the others: the operators of each block under its test map (`maps`), then under
        its preconditioner.

        whole: take the rows from there instead of from the full-order matrices; row_set: number of
        this set of rows in the run. Raises InputError, or SolveFailed for rows that do not
        distinguish the atoms.
        """
        heat: dict[str, SampledHeat] = {}
        elastic: dict[str, SampledElastic] = {}
        facts: dict[str, Mapping[str, float | int | str]] = {}
        notes = list(self.notes)
        maps = {n: self._map(n, rows.get(n)) for n in self.atoms}
        _, c1, c2, c1_first = self.step
        for b in self.model.separated.heat:
            n = b.thermal
            source = self._source(whole, n)
            if source is not None:
                th = source.heat[n].through(TestMap(rows[n]))
            else:
                th = ProjectedHeat.from_operators(b, self.dictionaries[n], maps[n])
            block, facts[n] = self._block(n, th.block(c1_first), maps[n], rows.get(n), notes)
            th = th.through(TestMap(left=block.weight))
            heat[n] = SampledHeat.from_operators(
                block, th, self.model, b, c1_first, self.options.tolerances)
        for m in self.model.separated.moving:
            if m.operators is None:
                continue
            n = m.elastic
            source = self._source(whole, n)
            if source is not None:
                te = source.elastic[n].through(TestMap(rows[n]))
            else:
                te = ProjectedElastic.from_operators(
                    m.operators, m.frame, self.dictionaries[n], self.dictionaries.get(m.thermal),
                    maps[n], rigid=self.model.separated.rigid_equations)
            block, facts[n] = self._block(n, te.block(c1, c2), maps[n], rows.get(n), notes)
            elastic[n] = SampledElastic.from_operators(
                block, te.through(TestMap(left=block.weight)))
        sampled = [*(h.block for h in heat.values()), *(e.block for e in elastic.values())]
        selecting = {block.name for block in sampled if block.selects}
        # terms between blocks: all unknowns together, where no atoms can be selected
        if self.model.separated.other or selecting & unselectable_blocks(self.model):
            return self._coupled(rows, maps, heat, elastic, facts, notes)
        return self._stepper(rows, maps, heat, elastic, facts, row_set, notes)

    def _coupled(
        self, rows: Mapping[str, IntArray], maps: Mapping[str, TestMap],
        heat: Mapping[str, SampledHeat], elastic: Mapping[str, SampledElastic], facts: Facts,
        notes: list[Note],
    ) -> ReducedGeneral:
        """Step solver for models in which terms couple bodies: the same least squares of each
        block's rows, solved by Newton's method for all unknowns together. Raises InputError where a
        budget is smaller than a dictionary, because atoms cannot be selected there."""
        blocks = _blocks(heat, elastic)
        faults = [Fault("reducer.budgets", unselectable(self.model, n, b.budget, b.atoms))
                  for n, b in blocks.items() if b.selects]
        if faults:
            raise InputError(faults)
        return reduced_general(
            self._projected(rows, maps, heat, elastic), self.options.tolerances,
            points=self.options.predictor, limits=self.limits,
            notes=(*unsampled_loads(self.model, rows), *notes), facts=facts)

    def _projected(
        self, rows: Mapping[str, IntArray], maps: Mapping[str, TestMap],
        heat: Mapping[str, SampledHeat], elastic: Mapping[str, SampledElastic],
        selecting: Container[str] = ()
    ) -> ProjectedModel:
        """All equations: under the least squares of each block's rows, with all atoms active; of
        the blocks `selecting`, in which atoms are selected, their compressed rows instead (left
        None). maps: test map of each block, of the sampled rows; forces: that of all other forces,
        in the rows of the block's operators."""

        def projected(s: SampledHeat | SampledElastic) -> ProjectedBlock[Any]:
            name = s.block.name
            m = s.forces or maps[name].then(s.block.weight)
            if name in selecting:
                return ProjectedBlock(operators=s.compressed[0], left=None, forces=m)
            return ProjectedBlock(
                operators=s.operators, left=s.block.left_inverse(support=None), forces=m)

        return ProjectedModel(
            self.model, self.dictionaries, rows, {n: projected(s) for n, s in heat.items()},
            {n: projected(s) for n, s in elastic.items()})

    def _source(self, whole: Whole | None, name: str) -> Whole | None:
        """Source of the rows of a block; None for rows of D^-1 r, which are not stored for the
        whole block."""
        return None if name in self.inverted else whole

    def _map(self, name: str, rows: IntArray | None) -> TestMap:
        """Test map of these rows of the residual r, or of D^-1 r with the operator D of a step;
        None for all rows of D^-1 r, compressed."""
        if rows is None:
            return TestMap(left=self.compressed[name].left)
        if name not in self.inverted:
            return TestMap(rows=rows)
        operator = self.model.block_data(name, step=self.step).operator
        return TestMap(left=inverse_rows(self.model, self.offline, name, operator, rows))

    def _block(
        self, name: str, B: FloatArray, test: TestMap, rows: IntArray | None, notes: list[Note]
    ) -> tuple[Sampled, Mapping[str, float | int | str]]:
        """A block with its preconditioner P, and the condition and recovery error of its rows; to
        `notes` one is added where the rows do not determine the coefficients well. B (m, k):
        operator of a step on the atoms in the sampled rows; rows: their numbers, None for all rows
        of D^-1 r. self.weights: facts of element weights, by block; atoms: largest number of active
        atoms, None for all; inverted: blocks whose rows are those of D^-1 r; compressed: all of
        these rows, as many as atoms."""
        P, inverted, d = None, name in self.inverted, self.dictionaries[name]
        if inverted:  # D^-1 D atoms, without the rounding of either
            B = self.compressed[name].B if rows is None else d.atoms[rows]
        if matched_option(name, dict.fromkeys(self.options.preconditioned, True), False):
            P = weigh(self.offline, self.options.preconditioner, name, B)
            if rows is not None and P is not None and len(P) < len(rows):
                notes.append(self._compressed(name, *B.shape))
        block = Sampled(name, d, test, budget=self.atoms[name] or B.shape[1],
                        B=B if P is None else P @ B, weight=P)
        measured = dict(self.weights.get(name, {}))
        if self.offline is not None:
            measured |= row_facts(B, P)
        if block.selects:
            notes += worse_conditioned(name, measured)
        # all rows recover the best of the active atoms: only a sample may not
        error = None if self.offline is None or rows is None else checked_rows(
            self.model, self.offline, block, self.step)
        if error is not None:
            measured["row_error"] = error.solved
            notes += [note for note in (row_note(error, block),) if note is not None]
        return block, {"norm": "D^-1" if inverted else "rows", **measured}

    def _compressed(self, name: str, m: int, k: int) -> Note:
        """Note on a preconditioner that is applied to rows compressed by QR."""
        what = (f"the {m} sampled rows of {name} are compressed by QR to as many as its {k} atoms, "
                "because this preconditioner is undefined for more rows than atoms")
        if (self.atoms[name] or k) < k:
            return information(f"reducer.preconditioner: {what}", "compressed_rows")
        (note,) = no_effect(["preconditioner"], (
            f"{what}, and all atoms are active, so that there is one solution, with or without it; "
            "give fewer atoms in reducer.budgets, or leave it out"))
        return note

    def _stepper(
        self, rows: Mapping[str, IntArray], maps: Mapping[str, TestMap],
        heat: Mapping[str, SampledHeat], elastic: Mapping[str, SampledElastic],
        facts: Mapping[str, Mapping[str, float | int | str]], row_set: int, notes: list[Note],
    ) -> StepSolver:
        """Step solver of a model whose blocks are solved one after the other; row_set: number of
        this set of rows in the run.

        Blocks in which no atoms are selected are condensed here, once (`base`). If there is no
        other block, that is all; the others are condensed in each step on its active atoms
        (`SparseStepper`)."""
        fixed_heat = {n: h.on(None) for n, h in heat.items() if not h.block.selects}
        fixed = not any(block.selects for block in _blocks(heat, elastic).values())
        # sampled rows that some loads may miss: D^-1 brings every load to every row
        plain = {n: r for n, r in rows.items() if n not in self.inverted}
        # maps of forces on all rows, for conduction between bodies
        coupled_maps = {
            c.rows: heat[c.rows].block.on_all_rows(heat[c.rows].columns.left_inverse(None))
            for c in self.model.separated.couplings}
        visited = {n: block.elements for n, block in fixed_heat.items()}
        groups = fixed_heat if not coupled_maps else heat_groups(
            self.model, fixed_heat, self.dictionaries, coupled_maps, self.step.c1_first)
        o, sizes = self.options, {n: d.atoms.shape[1] for n, d in self.dictionaries.items()}
        base = stepper(
            self.model, self.model.layout.resized(sizes), self.dictionaries, rows, heat=groups,
            tol=o.tolerances, points=o.predictor,
            factorizations=len(fixed_heat) + sum(not e.block.selects for e in elastic.values()),
            limits=self.limits, notes=(*unsampled_loads(self.model, plain), *notes),
            operators={n: e.operators for n, e in elastic.items()}, facts=facts, visited=visited)
        if fixed:
            projected = self._projected(rows, maps, heat, elastic)
            base = base.with_equations(reduced_general(
                projected, o.tolerances, o.predictor, ahead=self.offline is not None).equations)
            return compilable(base, o.compiled)
        # what follows is imported by runs that select atoms
        from sparsemor.reducers.sparse.block_selection import BlockwiseSelection
        from sparsemor.reducers.sparse.coupled_selection import JointSelection
        from sparsemor.reducers.sparse.supported_steps import SparseStepper, SupportedSteps

        base = replace(base, notes=(*base.notes, *no_effect_of(
            o.compiled, "atoms are selected during the run")))
        # all elastic blocks take part in the joint problem
        whole = o.selection == "joint" and any(e.block.selects for e in elastic.values())
        selecting = {n: replace(e, block=e.block.without_map())
                     for n, e in elastic.items() if whole or e.block.selects}
        selecting_heat = {n: h if h.body.local else replace(h, block=h.block.without_map())
                          for n, h in heat.items() if n not in fixed_heat}
        self._refuse(selecting_heat, selecting, base)
        residual = dense_equations(
            self._projected(rows, maps, heat, elastic, {*selecting, *selecting_heat}),
            ahead=self.offline is not None)
        mechanics = SupportedMechanics(
            SupportedEquations(residual), o.tolerances,
            {n: ActiveRows(np.arange(e.block.atoms)) for n, e in elastic.items()})
        steps = SupportedSteps(
            base=replace(base, mechanics=mechanics), mechanics=mechanics, heat=selecting_heat,
            elastic=selecting, row_set=row_set)
        # fraction by which other atoms must lower the residual
        gain = o.least_gain(not {*selecting, *selecting_heat} <= self.inverted)
        carried = frozenset(n for n in steps.empty if o.carries(n))
        selection = (
            BlockwiseSelection.from_steps(steps, o.solver, gain, bool(carried), o.settled)
            if o.selection == "blocks" else
            JointSelection(steps, gain, o.solver, carried, o.polish))
        return SparseStepper(steps.base, steps, selection, o.every)

    def _refuse(
        self, selecting_heat: Mapping[str, SampledHeat], selecting: Mapping[str, SampledElastic],
        base: BlockwiseSolver,
    ) -> None:
        """Raises InputError for a sparse solver that lacks capabilities which the problems of a
        step require. base.system.size: number of rigid coordinates and multipliers."""
        from sparsemor.reducers.sparse.recovery_problem import mechanics_needs, shape_needs

        problems = {n: shape_needs(*h.block.B.shape) for n, h in selecting_heat.items()}
        if self.options.selection == "blocks":
            problems |= {n: shape_needs(*e.block.B.shape) for n, e in selecting.items()}
        elif selecting:
            problems[", ".join(selecting)] = mechanics_needs(
                list(selecting.values()), base.system.size)
        refused = [Fault("reducer.solver", why) for n, needs in problems.items()
                   if (why := solver_refusal(n, self.options.solver, needs))]
        if refused:
            raise InputError(refused)


def _blocks(
    heat: Mapping[str, SampledHeat], elastic: Mapping[str, SampledElastic]
) -> dict[str, Sampled]:
    """Sampled rows of each block, by its name."""
    return {n: s.block for n, s in heat.items()} | {n: s.block for n, s in elastic.items()}


def step_solver(options: SparseOptions, problem: ReducedProblem) -> StepSolver:
    """Step solver of the reducer for a model: bases, sampled rows of each block or all rows of D^-1
    r compressed, weights of elements. Raises InputError and SolveFailed as `Build.solver`.

    inverted: blocks with rows of D^-1 r; sampled: blocks whose rows are drawn; counts: rows to draw
    of each; streams: random numbers of the first draw, `later` those of further ones; effects: of
    forces on all rows of a block on its coefficients, by which element weights are trained.
    """
    model, h, offline = problem.model, problem.step, problem.offline
    budgets = {n: matched_option(n, options.budgets, Budget()) for n in model.reducible()}
    step = StepFactors(h, *problem.integrator.rules(h).factors)
    bases = trial_bases(offline, model, options, step)
    sizes = {n: d.atoms.shape[1] for n, d in bases.dictionaries.items()}
    dictionaries, limits, unfit = spanned(bases, offline, {
        n for n, k in sizes.items() if (budgets[n].atoms or k) >= k})
    streams = dict(zip(budgets, problem.rng.spawn(len(budgets)), strict=True))
    inverted, drawn = inverted_blocks(model, options), samplers(model, options)
    sampled = [n for n in budgets if n not in inverted or options.samples(n)]
    counts = {n: budgets[n].rows for n in sampled}

    def draw(streams: Streams, keep: OfflineProducts | None) -> dict[str, IntArray]:
        """Sampled rows (m,) of each block, cached in `keep` if it is given."""
        return {n: choose_rows(
            model, keep, n, rows=counts[n], budget=budgets[n].atoms or 10**9, sampler=drawn[n],
            dictionary=dictionaries[n], rng=streams[n], step=step, preconditioned=n in inverted)
            for n in sampled}

    heat = {b.thermal for b in model.separated.heat}
    later = {n: rng.spawn(1)[0] for n, rng in streams.items()}
    rows = draw(streams, offline)
    # further draws take as many rows as the first
    counts = {n: len(r) - required_rows(model, n, drawn[n]) for n, r in rows.items()}
    local, atoms = own_terms(model), {n: d.atoms for n, d in dictionaries.items()}
    compressed = {n: CompressedRows.from_atoms(
        model, offline, n, step, atoms[n], changing=n in local and n not in heat)
        for n in sorted(inverted) if n not in rows}
    effects = {n: effect_of_rows(model, offline, n, step, atoms[n], rows[n])
               if n in rows else compressed[n].left for n in local if n in inverted}
    weighed, facts, weight_notes = _with_element_weights(options, problem, dictionaries, effects)
    build = Build(
        weighed, offline, options, dictionaries, limits,
        atoms={n: b.atoms for n, b in budgets.items()}, step=step, inverted=inverted,
        compressed=compressed,
        notes=(*unfit, *_idle_options(options, model, dictionaries, rows), *weight_notes),
        weights=facts)
    if options.resample is None:
        return build.solver(rows)
    return _resampled(options, build, rows, later, draw)


def _with_element_weights(
    options: SparseOptions, problem: ReducedProblem, dictionaries: Mapping[str, Dictionary],
    effects: Mapping[str, FloatArray]
) -> tuple[AssembledModel, Facts, tuple[Note, ...]]:
    """The model with element weights in the local terms of some blocks, facts of these weights and
    notes; effects (k, n): of forces on all rows of such a block on its coefficients."""
    if not effects:
        return problem.model, {}, ()
    from sparsemor.reducers.projection.ecsw.element_weights import WeightTraining

    model, s = problem.model, problem.model.separated
    training = WeightTraining(model, problem.offline, problem.step, options.tau, dictionaries,
                              effects.__getitem__)
    heat = tuple(training.heat(b) if b.thermal in effects else b for b in s.heat)
    moving = tuple(training.elastic(m) if m.elastic in effects else m for m in s.moving)
    weighed = model.with_separated(replace(s, heat=heat, moving=moving))
    return weighed, training.facts, training.notes()


def _idle_options(
    options: SparseOptions, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray]
) -> tuple[Note, ...]:
    """Notes on options that have no effect in this run; rows: sampled rows of each block."""
    atoms = {n: d.atoms.shape[1] for n, d in dictionaries.items()}
    active = {n: (matched_option(n, options.budgets, Budget()).atoms or k, k)
              for n, k in atoms.items()}
    return (
        *plain_rows(model, options), *unselected(options, active),
        *shadowed_basis(options, model, options.bases),
        *unread_sampler(options, {n: (len(r), block_size(model, n)) for n, r in rows.items()}),
        *unweighted(options, model, options.preconditioned))


def _resampled(
    options: SparseOptions, build: Build, rows: Mapping[str, IntArray], later: Streams,
    draw: Callable[[Streams, OfflineProducts | None], Mapping[str, IntArray]],
) -> StepSolver:
    """Step solver with resampling, which begins with the rows of a run without resampling: with
    `row_sets` row sets used in turn, or (None) with new rows in each draw; later: random streams of
    the further draws."""
    assert options.resample is not None
    whole = Whole.from_model(build.model, build.dictionaries)
    first = build.solver(rows, whole)
    if options.row_sets is None:
        online = replace(build, offline=None)

        def fresh(rows: Mapping[str, IntArray], number: int) -> StepSolver:
            return online.solver(rows, whole, number)

        return Resampled(
            first, sets=(first,), every=options.resample, draw=lambda s: draw(s, None),
            fresh=fresh, streams=later)
    others = [build.solver(draw(branched(later), build.offline), whole, i)
              for i in range(1, options.row_sets)]
    return Resampled(first, sets=(first, *others), every=options.resample, draw=None, fresh=None,
                     streams={})
