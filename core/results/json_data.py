"""Plain data for JSON."""

import math
from collections.abc import Mapping
from typing import Any


def finite(value: Any) -> Any:
    """The same plain data with nan and infinities, which JSON does not know, as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    return [finite(v) for v in value] if isinstance(value, list | tuple) else value
