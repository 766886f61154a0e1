"""Checks of values that plugins return, beyond their types: shapes, ranges and finite numbers."""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from sparsemor.core.protocols.cells import KINDS
from sparsemor.core.protocols.integrator import StepOutcome
from sparsemor.core.registry.value_types import NOT_FINITE, shown_type, unfit_arrays

Check: TypeAlias = Callable[[Any, Any, Mapping[str, Any]], str]
"""Returned value, plugin, arguments by name -> description of what is wrong with the value."""


def _shape(value: Any, *wanted: int) -> str:
    found = np.shape(value)
    return "" if found == wanted else f"an array of shape {found} instead of {wanted}"


def _dictionary(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    n, atoms = len(given["data"].snapshots), np.shape(value.atoms)
    if len(atoms) != 2 or atoms[0] != n or np.shape(value.offset) != (n,):
        return f"atoms {atoms} and offset {np.shape(value.offset)} for a block of {n} unknowns"
    return unfit_arrays(value)


def _rows(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    rows, n = np.asarray(value), given["block"].size
    if rows.ndim != 1:
        return f"an array of shape {rows.shape} instead of (r,)"
    if rows.size and (rows.min() < 0 or rows.max() >= n or len(np.unique(rows)) < len(rows)):
        return f"{rows.size} rows from {rows.min()} to {rows.max()}, not distinct ones below {n}"
    return ""


def _square(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return _shape(value, len(given["A"]), len(given["A"]))


def _like(name: str) -> Check:
    def check(value: Any, _: Any, given: Mapping[str, Any]) -> str:
        wanted = np.shape(given[name])
        parts = value if isinstance(value, tuple) else (value,)
        return next((w for v in parts if (w := _shape(v, *wanted))), "")
    return check


def _scalar(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return _shape(value)


def _state(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    n = given["layout"].size
    wrong = _shape(value.x, n) or _shape(value.v, n) or _shape(value.a, n)
    if not wrong and (np.ndim(value.memory) != 2 or len(value.memory) != n):
        wrong = f"a memory of shape {np.shape(value.memory)} instead of ({n}, j)"
    return wrong or (NOT_FINITE if unfit_arrays(value) and not unfit_arrays(given["state"])
                     else "")


def _rules(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    for rule in (value.second, value.first):
        j = np.size(rule.new)
        if wrong := unfit_arrays(rule):
            return wrong
        if j < 3 or np.shape(rule.new) != (j,) or np.shape(rule.old) != (j, j):
            return (f"rules of the shapes {np.shape(rule.new)} and {np.shape(rule.old)} instead of "
                    "(3 + j,) and (3 + j, 3 + j)")
    return ""


def _mesh(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    if wrong := unfit_arrays(value):
        return wrong
    points, cells = np.shape(value.points), np.shape(value.cells)
    if len(points) != 2 or len(cells) != 2 or (points[1], cells[1]) not in KINDS or not cells[0]:
        return f"points {points} and cells {cells} instead of (N, d) and (E, corners)"
    low, high = value.cells.min(), value.cells.max()
    return "" if low >= 0 and high < points[0] else (
        f"cells with corners {low} to {high} of {points[0]} points")


def _columns(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    n = len(given["start"].c)
    return _shape(value.c, n) or _shape(value.support, n)


def _support(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return _shape(value.support, len(given["support"]))


def _solution(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return _shape(getattr(value, "x", value), *np.shape(given["b"]))


def _step(value: Any, solver: Any) -> str:
    if type(value) is not tuple or len(value) != 2 or not isinstance(value[0], StepOutcome):
        return shown_type(value)
    x = value[0].x
    if not isinstance(x, np.ndarray) or x.dtype != np.float64:
        return f"unknowns that are {shown_type(x)}"
    if value[0].status.ok and not np.isfinite(x).all():
        return NOT_FINITE
    return "" if x.shape == (solver.layout.size,) else (
        f"{shown_type(x)} for {solver.layout.size} unknowns")


def _residual(value: Any, term: Any) -> str:
    if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
        return shown_type(value)
    return "" if value.shape == term.rows.shape else (
        f"{shown_type(value)} for {len(term.rows)} rows")


def _jacobian(value: Any, term: Any) -> str:
    dtype, shape = getattr(value, "dtype", None), (len(term.rows), len(term.columns))
    if dtype is None or dtype.kind != "f" or value.shape != shape:
        return f"{shown_type(value)} of {dtype} of shape {getattr(value, 'shape', ())} " \
               f"instead of {shape}"
    return ""


def _mapping(value: Any, _: Any) -> str:
    return "" if isinstance(value, Mapping) else shown_type(value)


def _start(value: Any, solver: Any, given: Mapping[str, Any]) -> str:
    n, state = solver.layout.size, value[0]
    return _shape(state.x, n) or _shape(state.v, n) or _shape(state.a, n)


def _initial(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return next((f"{name}: values and rates of the shapes {np.shape(x)} and {np.shape(v)}"
                 for name, (x, v) in value.items() if np.shape(x) != np.shape(v)), "")


def _observer(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    marked = (getattr(type(value), n, None) for n in dir(type(value)))
    return "" if any(hasattr(m, "sparsemor_impl") for m in marked) else (
        f"{shown_type(value)} without a method marked by hookimpl")


def _fields(value: Any, _: Any, given: Mapping[str, Any]) -> str:
    return unfit_arrays(value)


CHECKS: Mapping[tuple[str, str], Check] = {
    ("Basis", "build"): _dictionary, ("Sampler", "sample"): _rows,
    ("Preconditioner", "build"): _square, ("NormalLaw", "pressure"): _like("depth"),
    ("FrictionLaw", "ratio"): _like("slip"), ("Function", "value"): _scalar,
    ("Function", "rate"): _scalar, ("Integrator", "start"): _state,
    ("Integrator", "rules"): _rules, ("MeshPlugin", "build"): _mesh,
    ("SparseSolver", "solve"): _columns, ("Recovery", "select"): _support,
    ("Factorized", "solve"): _solution, ("Factorized", "outcome"): _solution,
    ("StepSolver", "start"): _start, ("Body", "initial"): _initial,
    ("Observer", "observer"): _observer, ("Check", "before_steps"): _fields,
    ("Check", "after_run"): _fields, ("Material", "properties"): _fields,
}
"""Protocol and member -> check of what it returns."""
EVERY_STEP: Mapping[tuple[str, str], Callable[[Any, Any], str]] = {
    ("StepSolver", "solve"): _step, ("StepSolver", "supports"): _mapping,
    ("StepSolver", "counters"): _mapping, ("Term", "residual"): _residual,
    ("Term", "jacobian"): _jacobian}
"""Protocol and member, called in every step -> all that is checked of what it returns."""
NAN_ALLOWED = frozenset({("Factorized", "solve"), ("StepSolver", "facts")})
"""Members whose values may be not finite: they say so by a status."""
