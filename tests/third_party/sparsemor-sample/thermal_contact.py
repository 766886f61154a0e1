"""Thermal contact resistance between two bodies: a load in a package of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.core import Body, Effect, Equations, FloatArray, InputError, Load, LoadPlugin, Part


@dataclass(frozen=True, slots=True, eq=False)
class Gap(Load):
    """Heat conductance (T_1 - T_2), W, out of the first of two bodies into the second.

    sides: thermal block of each body, and the weights (n,) of its mean temperature T_i.
    """

    name: str
    sides: tuple[tuple[str, FloatArray], tuple[str, FloatArray]]
    conductance: float

    def contribute(self, equations: Equations) -> None:
        for i, (rows, w) in enumerate(self.sides):
            for j, (columns, u) in enumerate(self.sides):
                sign = 1.0 if i == j else -1.0
                outer = csr_array(w[:, None]) @ csr_array(u[None, :])
                equations.matrix(rows, columns, A=sign * self.conductance * outer)


class ContactResistance(LoadPlugin):
    """A thermal contact resistance between sets of two bodies, by their mean temperatures."""

    acts_on: ClassVar[Effect] = "temperature"

    between: tuple[str, str]
    """The two sets `body:set`, of different bodies."""
    conductance: float = Field(gt=0)
    """Heat flow per difference of mean temperatures, W/K: one over the resistance."""

    def build(self, name: str, parts: Mapping[str, Part]) -> Gap:
        first, second = (_side(name, parts, text, f"between.{i}")
                         for i, text in enumerate(self.between))
        if first[0] == second[0]:
            raise InputError(f"both sets are on {first[0]}", "between")
        return Gap(name, (first, second), self.conductance)


def _side(name: str, parts: Mapping[str, Part], text: str, key: str) -> tuple[str, FloatArray]:
    body, _, which = text.partition(":")
    part = parts.get(body)
    probe = part.probe(name, which) if isinstance(part, Body) else None
    if probe is None:
        raise InputError(f"no body with material points is called {body!r}", key)
    weights = probe.temperature
    if weights is None:
        raise InputError(f"body {body!r} has no temperatures", key)
    return f"{body}.thermal", weights
