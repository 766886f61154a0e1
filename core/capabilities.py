"""What a sparse problem asks of its solver, in words, so that a refusal names what is missing."""

from typing import Any

CAPABILITIES = {
    "nonlinear": "a residual that is not linear in the coefficients",
    "unpenalised": "columns that are always active (groups without a budget)",
    "overdetermined": "more rows than columns (least squares)",
    "underdetermined": "fewer rows than columns",
}
"""Name -> what it means."""


def missing(solver: Any, needs: frozenset[str]) -> tuple[str, ...]:
    """The capabilities of `needs` that a solver lacks; one that declares none has them all."""
    has = getattr(solver, "capabilities", None)
    return () if has is None else tuple(sorted(needs - frozenset(has)))


def refusal(name: str, solver: Any, needs: frozenset[str]) -> str:
    """Why `solver` cannot take a problem called `name`; "" when it can."""
    lacking = missing(solver, needs)
    if not lacking:
        return ""
    what = "; ".join(f"{c}: {CAPABILITIES.get(c, 'unknown')}" for c in lacking)
    return f"{type(solver).__name__} cannot solve {name}, which needs {what}"


__all__ = ["CAPABILITIES", "missing", "refusal"]
