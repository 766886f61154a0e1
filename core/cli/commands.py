"""Commands of the program, which distributions offer by entry points of the group
`sparsemor.command`. Where two offer one name, that of another distribution than sparsemor is called
`package:name`.

A command is a function that typer takes as one. It is imported when it is called or the help lists
it.
"""

from collections.abc import Callable
from functools import wraps
from inspect import getdoc
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from sparsemor.core.cli.exit_codes import exit_codes
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry

GROUP = "command"


class Commands(TyperGroup):
    """The commands of entry points."""

    def list_commands(self, ctx: Any) -> list[str]:
        registry = Registry()
        return [registry.spelling(p) for p in registry.names(GROUP)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        return _found(cmd_name) if Registry().has(GROUP, cmd_name) else None


def _found(name: str) -> Any:
    """Command of an entry point. One that cannot be used says so in one line, when it is called
    and in the help."""
    try:
        return _made(name, function_of(Registry(), name))
    except InputError as error:
        reason = "; ".join(str(error).splitlines())
    except Exception as error:  # typer refuses the function's parameters
        reason = f"command {name!r} cannot be used ({type(error).__name__}: {error})"

    def refused() -> None:
        raise InputError(reason)

    refused.__doc__ = f"BROKEN: {reason}"
    return _made(name, refused, allow_extra_args=True, ignore_unknown_options=True)


def function_of(registry: Registry, name: str) -> Callable[..., Any]:
    """Function of a command. Raises InputError if it cannot be imported or is none."""
    loaded = registry.load(GROUP, name)
    if not callable(loaded) or not getdoc(loaded) or isinstance(loaded, type):
        raise InputError(f"command {name!r} is no function with a docstring, which is its help: "
                         "report it to the authors of that package")
    return loaded  # type: ignore[no-any-return]


def _made(name: str, function: Callable[..., Any], **settings: Any) -> Any:
    """Command of a function, with the messages and exit codes of all commands."""
    @wraps(function)
    def called(**options: Any) -> Any:
        with exit_codes(bool(options.get("as_json"))):
            try:
                return function(**options)
            except (typer.Exit, typer.Abort, typer.BadParameter) as raised:
                left = raised
        raise left  # which is no fault of the command

    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(name, context_settings=settings)(called)
    return get_command(app)
