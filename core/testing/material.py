"""Law kit of a material."""

import numpy as np

from sparsemor.core.protocols import Material
from sparsemor.core.testing.random_inputs import law

CONSTANTS = ("rho", "E", "nu", "alpha", "k", "c")


def check_material(material: Material) -> None:
    """Laws of a material: finite positive constants, or None where that is allowed; -1 < nu <
    1/2, so that the elastic energy is positive, alpha of either sign; equal values at every
    evaluation."""
    first, again = ({n: getattr(material, n) for n in CONSTANTS} for _ in range(2))
    law(first == again, "two evaluations differ: a constant is a constant")
    for name, value in first.items():
        if value is None:
            law(name not in ("rho", "alpha"), f"{name} is None: every material has it")
            continue
        law(isinstance(value, int | float) and not isinstance(value, bool),
            f"{name} is no number: {value!r}")
        law(bool(np.isfinite(value)), f"{name} is not finite")
        law(value > 0 or name in ("nu", "alpha"), f"{name} is not positive: {value:g}")
    law(first["nu"] is None or -1.0 < first["nu"] < 0.5, f"nu = {first['nu']}: -1 < nu < 1/2")
    law((first["E"] is None) is (first["nu"] is None), "E without nu, or nu without E")
