"""Variants of a scene for a stability survey: combinations of integrator, time step, sampler and
numbers of basis vectors and rows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from sparsemor.core import BlockBudget, Reducer, Sampler
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.scene.scene import Scene

Counts = tuple[int, ...]
"""One number for each reducible field, in the order of the fields."""


@dataclass(frozen=True, slots=True)
class SurveyPlan:
    """Values of the options that a stability survey varies; None: the value of the scene.

    samplers: names; required: whether rows on which joints and localized loads act are always
    sampled; rows, atoms: numbers of sampled rows and of active basis vectors for each reducible
    field; steps: time steps, s; integrators: names or `{use: name, option: value}`; seeds: number
    of seeds 1, 2, ..; at: times of linearisation, s (default: as in the check before a run).
    """

    samplers: Sequence[str] | None = None
    required: Sequence[bool] | None = None
    rows: Sequence[Counts] | None = None
    atoms: Sequence[Counts] | None = None
    steps: Sequence[float] | None = None
    integrators: Sequence[Any] | None = None
    seeds: int = 10
    at: Sequence[float] | None = None


@dataclass(frozen=True, slots=True)
class Variant:
    """One combination of options as a scene, and its settings as text for the columns of the
    table."""

    scene: Scene
    settings: Mapping[str, str]


def variants(scene: Scene, plan: SurveyPlan) -> Iterator[Variant]:
    """Scenes of every combination of the options; numbers of rows vary fastest, then basis vectors.
    Raises InputError."""
    fields = reduced_fields(scene)
    axes = (plan.integrators, plan.steps, plan.samplers, plan.required, plan.atoms, plan.rows)
    for integrator, step, sampler, required, atoms, rows in product(*(a or [None] for a in axes)):
        changed = scene
        if integrator is not None:
            changed = changed.using({"integrator": integrator}, label="--integrators")
        if step is not None:
            changed = changed.using({"time.step": step}, label="--step")
        reducer: Any = scene.reducer
        if sampler is not None or required is not None:
            assert isinstance(reducer, Plugin)
            reducer = reducer.model_copy(update={"sampler": _sampler(scene, sampler, required)})
        if atoms is not None or rows is not None:
            reducer = _with_budgets(scene.reducer_name, reducer, fields, rows, atoms)
        if reducer is not scene.reducer:
            options = {"--samplers": sampler, "--required": required, "--rows": rows,
                       "--atoms": atoms}
            label = ", ".join(name for name, value in options.items() if value is not None)
            changed = changed.with_reducer(reducer, label=label)
        yield Variant(changed, settings(changed))


def reduced_fields(scene: Scene) -> tuple[str, ...]:
    """Names of the fields that bodies of a scene may have and that can be reduced."""
    return tuple(k.name for k in scene.field_kinds if k.reducible)


def settings(scene: Scene) -> dict[str, str]:
    """Settings of a variant as text; "-" for an option that its reducer does not have. required:
    rows of joints and loads always sampled (`kept`) or sampled like all others (`drawn`)."""
    reducer, options = scene.reducer, dict(scene.dump()["integrator"])
    name = options.pop("use")
    words = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}"
                     for k, v in options.items())
    sampler: Sampler | None = getattr(reducer, "sampler", None)
    required = getattr(sampler, "required", None)
    budgets = [reducer.field_budget(field) for field in reduced_fields(scene)]

    def joined(counts: Sequence[int | None]) -> str:
        limited = any(b is not None for b in budgets)
        return "/".join("-" if n is None else str(n) for n in counts) if limited else "-"

    limits = [b or BlockBudget() for b in budgets]
    return {
        "sampler": "-" if sampler is None else _name(scene, sampler),
        "required": "-" if required is None else "kept" if required else "drawn",
        "rows": joined([b.rows for b in limits]), "atoms": joined([b.atoms for b in limits]),
        "integrator": f"{name} ({words})" if words else name, "step": f"{scene.time.step:g}"}


def _sampler(scene: Scene, name: str | None, required: bool | None) -> Sampler:
    """Sampler of a variant: the scene's own with its options, or another one with default
    options."""
    own: Sampler | None = getattr(scene.reducer, "sampler", None)
    if own is None:
        raise InputError(f"reducer {scene.reducer_name} takes no rows", "samplers")
    registry = scene.source.registry
    use = _name(scene, own) if name is None else name
    try:
        chosen: Any = own if use == _name(scene, own) else registry.get(
            "sampler", use).model_validate({}, context={"registry": registry})
    except InputError as error:
        raise error.under("samplers") from None
    if "required" in type(chosen).model_fields:
        kept = getattr(own, "required", True) if required is None else required
        chosen = chosen.model_copy(update={"required": kept})
    elif required is False:
        raise InputError(f"sampler {use} keeps the required rows in any case", "required")
    varied: Sampler = chosen
    return varied


def _name(scene: Scene, sampler: Sampler) -> str:
    return scene.source.registry.name_of("sampler", type(sampler))


def _with_budgets(
    name: str, reducer: Reducer, fields: Sequence[str], rows: Counts | None, atoms: Counts | None
) -> Reducer:
    found: Reducer | None = reducer
    if rows is not None:
        found = reducer.with_rows(_by_field("rows", fields, rows))
    if found is not None and atoms is not None:
        found = found.with_atoms(_by_field("atoms", fields, atoms))
    if found is None:
        raise InputError(f"reducer {name} has no budgets", "atoms" if rows is None else "rows")
    return found


def _by_field(option: str, fields: Sequence[str], counts: Counts) -> dict[str, int]:
    if len(counts) != len(fields):
        raise InputError(f"give {'/'.join(fields)}, {len(fields)} numbers "
                         f"(got {'/'.join(map(str, counts))})", option)
    return dict(zip(fields, counts, strict=True))
