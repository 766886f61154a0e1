"""Materials of flexible bodies: linear thermoelastic, with constants independent of temperature."""

from collections.abc import Sequence

from pydantic import Field

from sparsemor.core import Fault, InputError, Material, Plugin


class Isotropic(Plugin):
    """Isotropic material by its constants; a scene gives those that its fields need.

    Rigid motion needs rho; the elastic field E, nu, rho; the thermal field rho, k, c.
    """

    rho: float = Field(gt=0)
    """Density, kg/m3."""
    E: float | None = Field(default=None, gt=0)
    """Young's modulus, Pa."""
    nu: float | None = Field(default=None, gt=-1, lt=0.5)
    """Poisson's ratio."""
    alpha: float = 0.0
    """Coefficient of linear thermal expansion, 1/K."""
    k: float | None = Field(default=None, gt=0)
    """Thermal conductivity, W/(m K)."""
    c: float | None = Field(default=None, gt=0)
    """Specific heat, J/(kg K)."""


_MEANING = {
    "rho": "density, kg/m3", "E": "Young's modulus, Pa", "nu": "Poisson's ratio",
    "alpha": "thermal expansion, 1/K", "k": "conductivity, W/(m K)", "c": "specific heat, J/(kg K)",
}


def require(material: Material, names: Sequence[str], field: str) -> tuple[float, ...]:
    """Values of the constants `names`; InputError that names all missing ones."""
    values = {name: getattr(material, name) for name in names}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise InputError(
            [Fault(name, f"missing: the {field} field needs it ({_MEANING[name]})")
             for name in missing]
        )
    return tuple(float(value) for value in values.values())
