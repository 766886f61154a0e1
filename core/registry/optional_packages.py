"""Packages that only some solvers need."""

from importlib.util import find_spec

from sparsemor.core.errors import InputError


def require(module: str, extra: str, who: str) -> None:
    """InputError that names the extra when `module` is not installed. Imports nothing."""
    if find_spec(module) is None:
        raise InputError(
            f"{who} needs the package {module}, which is not installed: "
            f"pip install 'sparsemor[{extra}]'")
