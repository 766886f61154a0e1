"""Step solver of the reducer `sparse` from a model and its offline data."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    IntArray,
    Note,
    OfflineProducts,
    ReducedProblem,
    StepFactors,
    StepSolver,
)
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.reducers.checks import block_size, required_rows
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
)
from sparsemor.reducers.sparse.sampled_block import CompressedRows, choose_rows, effect_of_rows
from sparsemor.reducers.trial_bases import spanned, trial_bases


def step_solver(options: SparseOptions, problem: ReducedProblem) -> StepSolver:
    """Step solver of the reducer for a model: bases, sampled rows of each block or all rows of D^-1
    r compressed, weights of elements. Raises InputError and SolveFailed as `Build.solver`."""
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
    weighed, weights = _weighed(options, problem, dictionaries, effects)
    build = Build(
        weighed, offline, options, dictionaries, limits,
        {n: b.atoms for n, b in budgets.items()}, step, inverted, compressed,
        (*unfit, *_idle(options, model, dictionaries, rows), *weights.notes()), weights.facts)
    if options.resample is None:
        return build.solver(rows)
    return _resampled(options, build, rows, later, draw)


def _weighed(
    options: SparseOptions, problem: ReducedProblem, dictionaries: Mapping[str, Dictionary],
    effects: Mapping[str, FloatArray]
) -> tuple[AssembledModel, WeightTraining]:
    """The model with element weights in the local terms of some blocks, and their training;
    effects (k, n): of forces on all rows of such a block on its coefficients."""
    model, s = problem.model, problem.model.separated
    training = WeightTraining(model, problem.offline, problem.step, options.tau, dictionaries,
                              effects.__getitem__)
    heat = tuple(training.heat(b) if b.thermal in effects else b for b in s.heat)
    moving = tuple(training.elastic(m) if m.elastic in effects else m for m in s.moving)
    return model.with_separated(replace(s, heat=heat, moving=moving)), training


def _idle(
    options: SparseOptions, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray]
) -> tuple[Note, ...]:
    """Notes on options that have no effect in this run."""
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
    """Step solver with resampling, which begins with the rows of a run without resampling;
    later: random streams of the further draws."""
    assert options.resample is not None
    whole = Whole.of(build.model, build.dictionaries)
    first = build.solver(rows, whole)
    if options.row_sets is None:
        online = replace(build, offline=None)

        def fresh(rows: Mapping[str, IntArray], number: int) -> StepSolver:
            return online.solver(rows, whole, number)

        return Resampled(
            first, (first,), options.resample, lambda s: draw(s, None), fresh, later)
    others = [build.solver(draw(branched(later), build.offline), whole, i)
              for i in range(1, options.row_sets)]
    return Resampled(first, (first, *others), options.resample, None, None, {})
