"""Core's own commands are functions of the modules that are named for them."""

from typing import Any

import pytest
from typer.main import get_command

from sparsemor.core.cli import app
from sparsemor.core.cli.commands import OWN


@pytest.mark.parametrize("name", OWN)
def test_own_commands_are_functions_of_core(name: str) -> None:
    program: Any = get_command(app)
    function = program.get_command(None, name).callback.__wrapped__
    assert function.__module__ == f"sparsemor.core.cli.{name}"
    assert function.__name__ == name


def test_own_commands_come_first() -> None:
    program: Any = get_command(app)
    listed = program.list_commands(None)
    assert listed[:len(OWN)] == list(OWN) and len(set(listed)) == len(listed)
