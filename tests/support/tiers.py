"""Parameters of a test of which some are left to the full tier."""

from collections.abc import Iterable
from typing import Any

import pytest


def full(*values: Any) -> Any:
    """One set of values of the full tier."""
    return pytest.param(*values, marks=pytest.mark.full)


def quick(values: Iterable[Any], *chosen: Any) -> list[Any]:
    """All values; those that are not among `chosen` are marked `full`."""
    return [v if v in chosen else full(v) for v in values]
