"""The names of core's own commands are those that nobody else can take."""

from sparsemor.core.cli import app
from sparsemor.core.cli.commands import OWN


def test_own_names_are_those_of_core() -> None:
    assert tuple(c.name or c.callback.__name__ for c in app.registered_commands if c.callback) == (
        OWN)
