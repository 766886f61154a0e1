"""Validation of an export request, before anything is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import Gather, InputError
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.result_variables import FIELDS
from sparsemor.core.results.run_result import RunResult

FORMATS = ("vtu", "xdmf", "csv", "nc")
"""Of bodies with their fields, and of the whole run: time histories, and all arrays."""
OF_RUN = ("csv", "nc")
DEFAULT = ("displacement", "temperature")
"""Fields that are exported unless others are asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportPlan:
    """Validated export request. steps (j,): indices of the stored steps, increasing; fields: body
    -> names of its fields; notes: requested fields that a body does not have."""

    format: str
    steps: IntArray
    fields: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...]


def plan_export(
    run: RunResult, to: str, bodies: Sequence[str] | None, fields: Sequence[str] | None,
    at: Sequence[float] | None, every: int,
) -> ExportPlan:
    """Validated export request; `bodies`, `fields`, `at` (s) None: all. Raises InputError with
    every fault found."""
    if to not in OF_RUN and not run.bodies:
        raise InputError("no body of this run has a mesh: there are no points to write")
    if len(run.times) == 0:
        raise InputError("the run has no stored step yet")
    gather = Gather()  # gather(key, function, arguments): its faults under that key, until `check`
    gather("to", _check_name, to, FORMATS, "format", "formats")
    if to in OF_RUN and (bodies is not None or fields is not None):
        raise InputError(f"{to} is of the whole run: fields of single bodies go to vtu or xdmf",
                         "body" if bodies is not None else "fields")
    chosen = gather("body", _bodies, run, bodies)
    wanted = gather("fields", _fields, fields)
    steps = gather("at", run.steps_at, at)
    gather("every", _thinning, every, at)
    found: tuple[Mapping[str, tuple[str, ...]], tuple[str, ...]] | None = None
    if to in OF_RUN:
        found = {}, ()
    elif chosen is not None and wanted is not None:
        found = gather("fields", _by_body, run, chosen, wanted, fields is not None)
    gather.check()
    assert steps is not None and found is not None
    return ExportPlan(to, steps[::every], *found)


def make_folder(path: Path) -> None:
    """Makes a new folder. Raises InputError if there is one already, or it cannot be made."""
    try:
        path.mkdir()
    except OSError as error:
        raise InputError(f"{path} must be a new folder ({error.strerror})", "out") from None


def _check_name(name: str, names: Sequence[str], one: str, many: str) -> None:
    if name not in names:
        raise InputError(f"no {one} is called {name!r}: {suggestions(name, names, many)}")


def _each(names: Sequence[str], allowed: Sequence[str], one: str, many: str) -> None:
    gather = Gather()
    for name in names:
        gather("", _check_name, name, allowed, one, many)
    gather.check()
    if not names:
        raise InputError(f"name at least one: {', '.join(allowed)}")


def _bodies(run: RunResult, bodies: Sequence[str] | None) -> list[str]:
    if bodies is not None:
        _each(bodies, run.bodies, "body with a mesh", "bodies with a mesh")
    return list(dict.fromkeys(run.bodies if bodies is None else bodies))


def _fields(fields: Sequence[str] | None) -> tuple[str, ...]:
    if fields is None:
        return DEFAULT
    _each(fields, tuple(FIELDS), "field", "fields")
    return tuple(dict.fromkeys(fields))


def _by_body(
    run: RunResult, bodies: Sequence[str], wanted: Sequence[str], required: bool
) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
    """Body -> names of the requested fields that it has, and a note for each field that is absent.

    required: raise InputError if no body has a requested field.
    """
    found = {body: tuple(f for f in wanted if run.has(body, FIELDS[f]))
             for body in bodies}
    missing = tuple(f"{body} has no {field}: the run did not {_verb(field)} it"
                    for body in bodies for field in wanted if field not in found[body])
    if required and not any(found.values()):
        raise InputError("; ".join(missing))
    return found, missing if required else ()


def _thinning(every: int, at: Sequence[float] | None) -> None:
    if every < 1:
        raise InputError(f"`every` must be at least 1 (got {every})")
    if every > 1 and at is not None:
        raise InputError("give times or `every`, not both")


def _verb(field: str) -> str:
    return "solve for" if field in DEFAULT else "store what is needed for"
