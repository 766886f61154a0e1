"""Material properties as functions of temperature: tables and polynomials."""

from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, InputError, Plugin, TemperatureProperty


class Segments(NamedTuple):
    """Piecewise linear function by its segments, constant before the first and after the last node:
    the value at `start` and the slope of each."""

    nodes: FloatArray
    start: FloatArray
    values: FloatArray
    slopes: FloatArray


class TemperatureCurve(Plugin, TemperatureProperty):
    """A material property as a function of temperature, by a table or a polynomial. The specific
    heat may also be the slope of a table of the heat content, with latent heat as steep pieces.

    Outside the temperatures of the table, or the range of the polynomial, the property is constant;
    a run that gets there has a warning.
    """

    temperatures: tuple[float, ...] | None = Field(default=None, min_length=2)
    """Table: strictly increasing temperatures, K; linear in between."""
    values: tuple[float, ...] | None = Field(default=None, min_length=2)
    """Table: values at these temperatures."""
    enthalpy: tuple[float, ...] | None = Field(default=None, min_length=2)
    """Table, of a specific heat: heat content, J/kg, at these temperatures, which increases with
    temperature; linear in between. Only its differences matter."""
    polynomial: tuple[float, ...] | None = Field(default=None, min_length=1, max_length=8)
    """Polynomial: coefficients a0, a1, ... of a0 + a1 (T - origin) + a2 (T - origin)^2 + ..."""
    origin: float = 0.0
    """Polynomial: temperature, K, from which T is measured; 273.15 for coefficients in degrees
    Celsius."""
    range: tuple[float, float] | None = None
    """Polynomial: temperatures, K, between which it is valid."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Checks that there is either a table or a polynomial with its range."""
        if self.polynomial is None:
            self._check_table()
        elif self.temperatures is not None or self.values is not None or self.enthalpy is not None:
            raise InputError("give a table (temperatures, values) or a polynomial, not both")
        elif self.range is None:
            raise InputError("is missing: the temperatures [low, high], K, between which the "
                             "polynomial is valid", "range")
        elif not self.range[0] < self.range[1]:
            raise InputError("give [low, high], K, with low < high", "range")
        return self

    def _check_table(self) -> None:
        """Checks that temperatures increase and that there are as many values, of an enthalpy
        increasing ones."""
        T, values, name = self.temperatures, self.values, "values"
        if self.enthalpy is not None:
            if values is not None:
                raise InputError("give values or enthalpy, not both", "enthalpy")
            values, name = self.enthalpy, "enthalpy"
        if T is None or values is None:
            raise InputError("give a table (temperatures, values) or a polynomial with its range")
        if len(T) != len(values):
            raise InputError(f"{len(values)} values for {len(T)} temperatures", name)
        low = next((i for i, (a, b) in enumerate(zip(T, T[1:], strict=False)) if b <= a), None)
        if low is not None:
            raise InputError(f"{T[low + 1]:g} K after {T[low]:g} K: temperatures must increase",
                             "temperatures")
        if name == "enthalpy":
            at = next((i for i, (a, b) in enumerate(zip(values, values[1:], strict=False))
                       if not b > a), None)
            if at is not None:
                raise InputError(f"{values[at + 1]:g} J/kg at {T[at + 1]:g} K after "
                                 f"{values[at]:g} J/kg: the heat content must increase", name)
        if self.range is not None or self.origin:
            raise InputError("`range` and `origin` belong to a polynomial, not to a table")

    @property
    def degree(self) -> int:
        """Polynomial degree; 1 for a table."""
        return 1 if self.polynomial is None else len(self.polynomial) - 1

    @property
    def limits(self) -> tuple[float, float]:
        """Temperatures, K, between which the curve is defined."""
        if self.temperatures is not None:
            return self.temperatures[0], self.temperatures[-1]
        assert self.range is not None
        return self.range

    @cached_property
    def numbers(self) -> FloatArray:
        """The curve by numbers (`TemperatureProperty.numbers`)."""
        if self.polynomial is None:
            found = self._segments
            return np.concatenate([[0.0, len(found.nodes)], *found])
        return np.array([1.0, len(self.polynomial), self.origin, *self.limits, *self.polynomial])

    @property
    def least(self) -> float:
        """Smallest value."""
        if self.polynomial is None:
            return float(self._segments.values.min())
        roots = np.atleast_1d(np.asarray(self._powers.deriv().roots(), dtype=np.complex128))
        stationary = [float(z.real) + self.origin for z in roots if abs(z.imag) < 1e-9]
        low, high = self.limits
        at = [low, high, *(T for T in stationary if low < T < high)]
        return float(np.min(self.at(np.array(at))[0]))

    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives by temperature at temperatures T, K, of any shape. Of a table
        those of segment i, above i of its nodes: values[i] + slopes[i] (T - start[i]); of a
        polynomial (_powers, in T - origin), constant outside of its limits."""
        if self.polynomial is None:
            nodes, start, values, slopes = self._segments
            i = nodes.searchsorted(T)
            slope = slopes[i]
            return values[i] + slope * (T - start[i]), slope
        low, high = self.limits
        inside = np.clip(T, low, high)
        z = inside - self.origin
        slope = np.where(inside == T, self._powers.deriv()(z), 0.0)
        return np.asarray(self._powers(z)), slope

    def integral(self, T: FloatArray) -> FloatArray:
        """Integral over temperature from the lower limit to T, K: of a specific heat the heat
        content, J/kg. Of a table: _sums, up to the start of each segment, and the part in it; of a
        polynomial that within its limits, and beyond them a constant value times T less the
        limit."""
        if self.polynomial is None:
            nodes, start, values, slopes = self._segments
            i = nodes.searchsorted(T)
            z = T - start[i]
            return np.asarray(self._sums[i] + z * (values[i] + 0.5 * slopes[i] * z))
        low, high = self.limits
        inside, whole = np.clip(T, low, high), self._powers.integ()
        return np.asarray(whole(inside - self.origin) - whole(low - self.origin)
                          + self._powers(inside - self.origin) * (T - inside))

    @cached_property
    def _sums(self) -> FloatArray:
        """Integral up to the start of each segment."""
        nodes, _, values, slopes = self._segments
        z = np.diff(nodes)
        pieces = z * (values[1:-1] + 0.5 * slopes[1:-1] * z)
        return np.concatenate([[0.0, 0.0], np.cumsum(pieces)])

    @cached_property
    def _segments(self) -> Segments:
        """Linear segments of the table, n - 1 between its n temperatures and a constant one at
        either end; of an enthalpy its slopes, constant in each."""
        T = np.array(self.temperatures)
        if self.enthalpy is not None:
            c = np.diff(self.enthalpy) / np.diff(T)
            return Segments(T, np.concatenate([T[:1], T[:-1], T[-1:]]),
                            np.concatenate([c[:1], c, c[-1:]]), np.zeros(len(T) + 1))
        values = np.array(self.values)
        slopes = np.diff(values) / np.diff(T)
        return Segments(T, np.concatenate([T[:1], T[:-1], T[-1:]]),
                        np.concatenate([values[:1], values[:-1], values[-1:]]),
                        np.concatenate([[0.0], slopes, [0.0]]))

    @cached_property
    def _powers(self) -> np.polynomial.Polynomial:
        return np.polynomial.Polynomial(np.array(self.polynomial))
