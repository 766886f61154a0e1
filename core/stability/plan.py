"""Which variants of a scene a stability survey looks at."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.scene import Scene

Pair = tuple[int, int]
FIELDS = ("elastic", "thermal")


@dataclass(frozen=True, slots=True)
class Plan:
    """What is varied; None keeps what the scene has. rows, atoms: (elastic, thermal).

    required: whether the rows of joints and loads are kept; steps: s; integrators: a name or
    `{use: name, ..}`; seeds: how many, 1, 2, ..; at: times of the linearisations, s (as `run` does
    when not given: from the start to the end).
    """

    samplers: Sequence[str] | None = None
    required: Sequence[bool] | None = None
    rows: Sequence[Pair] | None = None
    atoms: Sequence[Pair] | None = None
    steps: Sequence[float] | None = None
    integrators: Sequence[Any] | None = None
    seeds: int = 10
    at: Sequence[float] | None = None


@dataclass(frozen=True, slots=True)
class Variant:
    """One combination as a scene, and its settings in words (for the columns of the table)."""

    scene: Scene
    settings: Mapping[str, str]


def variants(scene: Scene, plan: Plan) -> Iterator[Variant]:
    """Every combination, rows and atoms varying fastest. Raises InputError."""
    known = scene.source.registry
    axes = (plan.integrators, plan.steps, plan.samplers, plan.required, plan.atoms, plan.rows)
    for integrator, step, sampler, required, atoms, rows in product(*(a or [None] for a in axes)):
        changes: dict[str, Any] = {}
        if integrator is not None:
            changes["integrator"] = integrator
        if step is not None:
            changes["time.step"] = step
        own = scene.dump()["reducer"]
        if sampler is not None or required is not None:
            changes["reducer.sampler"] = _sampler(own, sampler, required, known)
        if atoms is not None:
            changes |= _bases(own, atoms)
        if atoms is not None or rows is not None:
            changes["reducer.budgets"] = _budgets(own, rows, atoms)
        changed = scene.using(changes, label="variant") if changes else scene
        yield Variant(changed, settings(changed))


def settings(scene: Scene) -> dict[str, str]:
    """What distinguishes a variant; "-" where its reducer has no such option."""
    tree = scene.dump()
    reducer, integrator = tree["reducer"], tree["integrator"]
    sampler, options = reducer.get("sampler", {}), dict(integrator)
    name = options.pop("use")
    told = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}"
                     for k, v in options.items())
    budgets = reducer.get("budgets", {})

    def pair(key: str) -> str:
        found = [_budget(budgets, field).get(key) for field in FIELDS]
        return "/".join("-" if v is None else str(v) for v in found) if budgets else "-"

    return {
        "sampler": sampler.get("use", "-"),
        "required": {True: "kept", False: "drawn"}.get(sampler.get("required"), "-"),
        "rows": pair("rows"), "atoms": pair("atoms"),
        "integrator": f"{name} ({told})" if told else name, "step": f"{scene.time.step:g}"}


def _sampler(own: Mapping[str, Any], name: str | None, required: bool | None, known: Any) -> Any:
    if "sampler" not in own:
        raise InputError(f"--samplers: reducer {own['use']} takes no rows")
    use = own["sampler"]["use"] if name is None else name
    chosen = dict(own["sampler"]) if use == own["sampler"]["use"] else {"use": use}
    if "required" in known.get("sampler", use).model_fields:
        kept = own["sampler"].get("required", True) if required is None else required
        return chosen | {"required": kept}
    if required is False:
        raise InputError(f"--required: sampler {use} keeps the required rows in any case")
    return chosen


def _budgets(
    own: Mapping[str, Any], rows: Pair | None, atoms: Pair | None
) -> dict[str, dict[str, Any]]:
    if "budgets" not in own:
        raise InputError(f"--rows, --atoms: reducer {own['use']} has no budgets")
    made = {}
    for i, field in enumerate(FIELDS):
        budget = dict(_budget(own["budgets"], field))
        if rows is not None:
            budget["rows"] = rows[i]
        if atoms is not None:
            budget["atoms"] = atoms[i]
        if budget:
            made[f"*.{field}"] = budget
    return made


def _bases(own: Mapping[str, Any], atoms: Pair) -> dict[str, Any]:
    """Bases that count their atoms follow the budgets: nothing is left to select."""
    changes: dict[str, Any] = {}
    shared = own.get("basis", {})
    if "count" in shared:
        changes["reducer.basis"] = {**shared, "count": atoms[0]}
    bases = dict(own.get("bases", {}))
    thermal = bases.get("*.thermal", shared)
    if "count" in thermal:
        bases["*.thermal"] = {**thermal, "count": atoms[1]}
        changes["reducer.bases"] = bases
    return changes


def _budget(budgets: Mapping[str, Any], field: str) -> Mapping[str, Any]:
    """The budget of a field: its own pattern's, else the first that names it."""
    own = [v for k, v in budgets.items() if k.endswith(f".{field}") or k == "*"]
    found: Mapping[str, Any] = budgets.get(f"*.{field}", own[0] if own else {})
    return found
