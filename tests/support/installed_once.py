"""Entry points of the installed distributions, read once for each search path. Every scene of every
test looks plugins up; reading the metadata of all distributions again each time takes a tenth of
the time of the default tier."""

import sys
from functools import cache
from importlib import metadata
from typing import Any

whole = metadata.entry_points


class Found:
    """What `importlib.metadata.entry_points` returns, with each selection kept."""

    def __init__(self) -> None:
        found: Any = whole()
        self.groups = found.groups
        self.select = cache(found.select)


@cache
def found(path: tuple[str, ...]) -> Found:
    return Found()


def entry_points(**params: str) -> Any:
    """In place of `importlib.metadata.entry_points`. A distribution is seen when its folder joins
    `sys.path`, as those do that tests make."""
    all_of_them = found(tuple(sys.path))
    return all_of_them.select(**params) if params else all_of_them
