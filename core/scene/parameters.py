"""Parameters of a scene: numbers of the scene with a name and a range. Their ranges span a box,
over which a reduced model is trained, run and tested."""

from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from typing import Annotated, Any, TypeGuard

from pydantic import BaseModel, Field, model_validator

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.protocols import TimeFunction
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.scene.overrides import find, split

Point = Mapping[str, float]
"""Parameter -> value."""
_NO_MODEL = ("format", "seed", "time", "output", "parameters", "training", "reducer")
"""Keys with numbers that are not of the model: training runs over a box have the same steps."""


class Parameter(Plugin):
    """Number of the scene, at one key or at several that have the same value, and its range."""

    key: str | Annotated[list[str], Field(min_length=1)]
    """Dotted key of the scene, as for `--set`, or several."""
    range: Annotated[list[float], Field(min_length=2, max_length=2)]
    """Smallest and largest value."""

    @model_validator(mode="after")
    def _ordered(self) -> "Parameter":
        if not self.range[0] < self.range[1]:
            raise InputError(f"the first value must be the smaller one (got {self.range})", "range")
        return self

    @property
    def keys(self) -> tuple[str, ...]:
        return (self.key,) if isinstance(self.key, str) else tuple(self.key)

    def at(self, share: float) -> float:
        """Value at a share of the range: 0 the smallest, 1 the largest."""
        low, high = self.range
        return low + share * (high - low)


def values_at(point: Point) -> dict[str, float]:
    """Values of parameters as overrides. Raises InputError for anything but names and values."""
    if not isinstance(point, Mapping):
        raise InputError(f"give names with values, such as {{flux: 1e6}} (got {point!r})")
    return {f"parameters.{name}": value for name, value in point.items()}


def with_values(tree: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides in which `parameters.NAME: number` is replaced by the keys of that parameter of the
    scene `tree`. Raises InputError for an unknown parameter."""
    found: dict[str, Any] = {}
    declared = tree.get("parameters")
    named = declared if isinstance(declared, Mapping) else {}
    for key, value in overrides.items():
        path = split(key)
        if len(path) != 2 or path[0] != "parameters" or value is None or isinstance(
                value, Mapping | BaseModel):
            found[key] = value
            continue
        if not _is_number(value):
            raise InputError(f"the value of a parameter is a number (got {value!r})", key)
        entry = named.get(path[1])
        if not isinstance(entry, Mapping) or "key" not in entry:
            raise InputError([Fault(key, "the scene declares no such parameter: "
                                    + suggestions(str(path[1]), list(named), "declared"))])
        keys = entry["key"]
        plain = value if isinstance(value, int) else float(value)
        found |= dict.fromkeys([keys] if isinstance(keys, str) else keys, plain)
    return found


def parameter_faults(
    parameters: Mapping[str, Parameter], scene: BaseModel, tree: Mapping[str, Any]
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Location and message of each fault: keys without a number, keys of one parameter with
    different values. tree: the data of the scene."""
    owners: dict[tuple[str | int, ...], str] = {}
    for name, p in parameters.items():
        values = [number_at(scene, tree, key) for key in p.keys]
        numbers = [v for v in values if v is not None]
        at = ("parameters", name, "key")
        for i, (key, value) in enumerate(zip(p.keys, values, strict=True)):
            if value is None:
                yield at if isinstance(p.key, str) else (*at, i), (
                    f"there is no number of the model at {key or 'no key'} in the scene: give "
                    "the key of one, and write it there")
            elif (owner := owners.setdefault(tuple(find(tree, key)), name)) != name:
                yield at if isinstance(p.key, str) else (*at, i), (
                    f"{key} is a key of parameter {owner} already")
        if numbers == values and len(set(numbers)) > 1:
            yield at, f"its keys have different values: {', '.join(f'{v:g}' for v in numbers)}"


def number_at(scene: BaseModel, tree: Mapping[str, Any], key: str) -> float | None:
    """Number at a dotted key of a scene (of a function of time: its only option), None where there
    is none. tree: the data of the scene."""
    path = find(tree, key)
    if path[0] in _NO_MODEL:
        return None
    value: object = scene
    for part in path:
        if isinstance(value, BaseModel):
            value = dict(value).get(str(part))
        elif isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, Sequence) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    if isinstance(value, TimeFunction) and isinstance(value, BaseModel):
        options = [option for _, option in value]
        value = options[0] if len(options) == 1 else None
    return float(value) if _is_number(value) else None


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, Real) and not isinstance(value, bool)
