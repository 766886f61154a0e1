"""Load of a scene: a name and a function that adds its contributions to the equations; its options:
magnitudes that are numbers or functions of time, and vectors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from sparsemor.core import (
    Amplitude,
    Body,
    Equations,
    FloatArray,
    InputError,
    Load,
    Note,
    Slot,
    TimeFunction,
)


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


Vector = tuple[float, float] | tuple[float, float, float]


def components(body: Body, vector: Sequence[float], key: str) -> FloatArray:
    """(d,) array of a vector; InputError if its number of components differs from the body's
    dimension."""
    if len(vector) != body.d:
        where = "in space: give three components" if body.d == 3 else "plane: give two components"
        raise InputError(f"body {body.name!r} is {where} (got {list(vector)})", key)
    return np.array(vector, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class LoadPart(Load):
    """Load of a scene; `write(equations)` adds it to the equations.

    localized: hyper-reduction keeps its rows; surroundings: temperature (K) of a heat exchange, or
    prescribed temperature, if any; notes: warnings on its options; adjusted: bodies that it
    replaces by modified ones.
    """

    name: str
    write: Callable[[Equations], None]
    localized: bool = True
    surroundings: Amplitude | None = None
    notes: tuple[Note, ...] = ()
    adjusted: Mapping[str, Body] = field(default_factory=dict)

    def contribute(self, equations: Equations) -> None:
        self.write(equations)
