"""Parameters of a test of which some are left to the full tier."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick(values: Iterable[Any], *chosen: Any) -> list[Any]:
    """All values; those that are not among `chosen` are marked `full`."""
    return [v if v in chosen else pytest.param(v, marks=pytest.mark.full) for v in values]
