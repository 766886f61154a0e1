"""Units with SI prefixes for axis labels: milliseconds, micrometres, megapascals."""

from typing import NamedTuple


class Unit(NamedTuple):
    """Unit `name`: a value in SI units times `factor` is the value in this unit."""

    factor: float
    name: str


_SMALL = ((1e9, "n"), (1e6, "µ"), (1e3, "m"), (1.0, ""))
_LARGE = ((1e-3, "k"), (1e-6, "M"), (1e-9, "G"))
_ONLY_SMALL = ("s", "m", "rad")
"""Units without prefixes for large values: no kiloseconds or megametres."""


def unit(largest: float, si: str) -> Unit:
    """Unit with the prefix for which `largest` (SI unit `si`, either sign) is between 0.5 and
    500."""
    sizes = _SMALL if si in _ONLY_SMALL else _SMALL + _LARGE
    if largest == 0.0:
        return Unit(1.0, si)
    factor, prefix = next((s for s in sizes if abs(largest) * s[0] < 500.0), sizes[-1])
    return Unit(factor, prefix + si)
