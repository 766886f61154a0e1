"""Check for optional dependencies, such as packages of some linear solvers."""

from importlib.util import find_spec

from sparsemor.core.errors import InputError


def require(module: str, extra: str, who: str) -> None:
    """Raises InputError with the name of the pip extra if `module` is not installed. Imports
    nothing. who: the plugin that needs it."""
    if find_spec(module) is None:
        raise InputError(
            f"{who} needs the package {module}, which is not installed: "
            f"pip install 'sparsemor[{extra}]'")
