"""Law kit of a material."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.body import Material, TemperatureProperty
from sparsemor.core.testing.random_inputs import law

CURVES = ("E", "alpha", "k", "c")
SIGNED = ("nu", "alpha")


def check_material(material: Material) -> None:
    """Laws of a material: finite positive properties, or None where that is allowed; -1 < nu <
    1/2, so that the elastic energy is positive, alpha of either sign; equal values at every
    evaluation; properties that depend on the direction symmetric and positive definite. Functions
    of temperature are defined in an interval, constant outside, and have the derivatives that they
    return."""
    first, again = (vars(material.properties()) for _ in range(2))
    for name, value in first.items():
        if isinstance(value, TemperatureProperty):
            # CURVES: the properties that may depend on temperature
            law(name in CURVES, f"{name} depends on temperature: it is a constant")
            _curve(name, value, again[name])
        else:
            law(value == again[name], "two evaluations differ: a constant is a constant")
            _number(name, value)
    nu = first["nu"]
    law(nu is None or -1.0 < nu < 0.5, f"nu = {nu}: -1 < nu < 1/2")
    law((first["E"] is None) is (nu is None), "E without nu, or nu without E")
    of = material.directional()
    for name, value in {} if of is None else {
            "stiffness": of.stiffness, "conductivity": of.conductivity}.items():
        law(value is None or np.allclose(value, value.T, atol=1e-9 * np.abs(value).max()),
            f"{name} is not symmetric")
        law(value is None or bool((np.linalg.eigvalsh(value) > 0.0).all()),
            f"{name} is not positive definite")


def _number(name: str, value: object) -> None:
    if value is None:
        law(name not in ("rho", "alpha"), f"{name} is None: every material has it")
        return
    law(isinstance(value, int | float) and not isinstance(value, bool),
        f"{name} is no number: {value!r}")
    number = float(value)  # type: ignore[arg-type]
    law(bool(np.isfinite(number)), f"{name} is not finite")
    law(number > 0 or name in SIGNED, f"{name} is not positive: {number:g}")


def _curve(name: str, curve: TemperatureProperty, again: object) -> None:
    """Checks a property of temperature: finite, positive, with its derivative, constant beyond its
    limits."""
    low, high = curve.limits
    law(bool(np.isfinite([low, high]).all() and low < high), f"limits of {name}: {low} to {high} K")
    law(curve.degree >= 0, f"degree of {name}: {curve.degree}")
    T: FloatArray = low + (high - low) * (np.arange(400.0).reshape(100, 4) + 0.5) / 400.0
    (values, slopes), step = curve.at(T), 1e-4 * (high - low)
    law(values.shape == slopes.shape == T.shape, f"{name}: values and derivatives of shape T")
    law(isinstance(again, TemperatureProperty) and np.array_equal(again.at(T)[0], values),
        "two evaluations differ: a property is a function of temperature")
    law(bool(np.isfinite(values).all()), f"{name} is not finite")
    law(bool((values > 0).all()) or name in SIGNED,
        f"{name} is not positive: {values.min():g}")
    quotient = (curve.at(T + step)[0] - curve.at(T - step)[0]) / (2 * step)
    size = np.abs(quotient).max() + np.abs(values).max() / (high - low)
    # a table has kinks, at each of which one difference quotient is that of two pieces
    wrong = np.abs(slopes - quotient) > 1e-3 * size
    law(np.count_nonzero(wrong) <= 0.1 * T.size, f"{name}: derivatives differ from its values")
    beyond = np.array([low - 50.0, high + 50.0])
    ends, flat = curve.at(beyond)
    law(np.allclose(ends, curve.at(np.array([low, high]))[0]) and not flat.any(),
        f"{name} is not constant outside its limits")
