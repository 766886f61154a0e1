"""Options that are numbers: true and false are refused at any depth, whole numbers are taken."""

from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field, ValidationError

from sparsemor.core import Plugin
from sparsemor.core.registry.registry import Registry
from sparsemor.core.registry.validation_errors import faults_of


class Part(Plugin):
    length: float = 1.0


class Whole(Plugin):
    size: float = Field(default=1.0, gt=0)
    count: int | None = None
    lengths: list[float] | Literal["all"] = "all"
    pair: tuple[float, float] = (0.0, 0.0)
    limits: dict[str, Annotated[float, Field(gt=0)]] = {}
    version: Literal[1, 2] = 1
    part: Part = Part()
    rest: "Whole | None" = None
    switch: bool = False
    either: bool | float = 0.0


@pytest.mark.parametrize(("options", "key", "words"), [
    ({"size": True}, "size", "a valid number (got true)"),
    ({"size": np.True_}, "size", "a valid number (got True)"),
    ({"count": False}, "count", "a valid integer (got false)"),
    ({"lengths": [1, True]}, "lengths.1", "a valid number (got true)"),
    ({"pair": [False, 0]}, "pair.0", "a valid number (got false)"),
    ({"limits": {"a": True}}, "limits.a", "a valid number (got true)"),
    ({"version": True}, "version", "should be 1 or 2 (got true)"),
    ({"part": {"length": True}}, "part.length", "a valid number (got true)"),
    ({"rest": {"part": {"length": True}}}, "rest.part.length", "a valid number (got true)"),
])
def test_true_and_false_are_no_numbers(options: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Whole.model_validate(options)
    (fault,) = faults_of(caught.value, options)
    assert fault.key == key
    assert fault.message.endswith(words)


def test_all_else_is_taken_as_before() -> None:
    made = Whole.model_validate({"size": 2, "count": 3, "lengths": [1], "version": 2,
                                 "switch": True, "either": True})
    assert (made.size, made.count, made.lengths, made.version) == (2.0, 3, [1.0], 2)
    assert made.switch is True and made.either is True
    assert Whole.model_validate({"size": "1e6"}).size == 1e6


NUMBERS = {"number", "integer"}


@pytest.mark.full
def test_no_plugin_takes_true_for_a_number() -> None:
    """All installed plugins that can be imported, and all their options that are numbers."""
    registry, tried = Registry(), 0
    for kind in registry.kinds():
        for plugin in registry.names(kind):
            if plugin.distribution == "sparsemor-broken":
                continue
            cls = registry.load(kind, plugin.qualified)
            if not (isinstance(cls, type) and issubclass(cls, Plugin)):
                continue  # a scene, a study, or hooks
            for option, schema in cls.model_json_schema()["properties"].items():
                types = {schema.get("type"), *(c.get("type") for c in schema.get("anyOf", ()))}
                if not types & NUMBERS or "boolean" in types:
                    continue
                with pytest.raises(ValidationError) as caught:
                    cls.model_validate({option: True})
                assert option in {e["loc"][0] for e in caught.value.errors()}, (plugin, option)
                tried += 1
    assert tried > 50
