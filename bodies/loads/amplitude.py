"""Magnitude of a load: a number, or a function of time."""

from typing import Annotated, Any

from pydantic import BeforeValidator

from sparsemor.core import Amplitude, Slot, TimeFunction


def _number_as_function(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"use": "constant", "level": value}
    return value


NumberOrFunction = Annotated[
    TimeFunction, Slot("function"),
    BeforeValidator(_number_as_function,
                    json_schema_input_type=float | Annotated[Any, Slot("function")]),
]
"""A number, or a time function: `1e6`, `{use: ramp, end: 0.5, to: 1e6}`."""


def unit(t: float) -> float:
    """Amplitude 1 of a constant load."""
    return 1.0


def amplitude(function: TimeFunction | None) -> Amplitude:
    """Values of a function of time as an amplitude; 1 for None."""
    return unit if function is None else function.value
