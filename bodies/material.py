"""Materials of flexible bodies: isotropic, linear thermoelastic, constant or functions of
temperature."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag

from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.core import (
    BoolArray,
    Csr,
    Fault,
    InputError,
    IntArray,
    Material,
    MaterialProperties,
    Mesh,
    TemperatureProperty,
    suggestions,
)
from sparsemor.core.protocols.body import DirectionalProperties


def _positive(curve: TemperatureCurve) -> TemperatureCurve:
    if not curve.least > 0.0:
        raise InputError(f"must be positive at all temperatures (its smallest value is "
                         f"{curve.least:g})")
    return curve


def _kind(value: object) -> str:
    """Branch of a property: its tags are no option names, so that errors have the key of the
    property."""
    return "a curve" if isinstance(value, Mapping | TemperatureCurve) else "a number"


Positive = Annotated[
    Annotated[float, Field(gt=0), Tag("a number")]
    | Annotated[TemperatureCurve, AfterValidator(_positive), Tag("a curve")],
    Discriminator(_kind)]
"""A positive number, or a positive function of temperature."""
Property = Annotated[
    Annotated[float, Tag("a number")] | Annotated[TemperatureCurve, Tag("a curve")],
    Discriminator(_kind)]
"""A number, or a function of temperature."""


class Isotropic(Material):
    """Isotropic material; a scene gives the properties that its fields need.

    Rigid motion needs rho; the elastic field E, nu, rho; the thermal field rho, k, c. E, alpha, k
    and c are numbers or functions of temperature (a table, or a polynomial).
    """

    rho: float = Field(gt=0)
    """Density in the reference shape, kg/m3."""
    E: Positive | None = None
    """Young's modulus, Pa."""
    nu: float | None = Field(default=None, gt=-1, lt=0.5)
    """Poisson's ratio."""
    alpha: Property = 0.0
    """Mean coefficient of linear thermal expansion between the reference temperature of the body
    and T, 1/K: the thermal strain is alpha(T) (T - T_ref)."""
    k: Positive | None = None
    """Thermal conductivity, W/(m K)."""
    c: Positive | None = None
    """Specific heat, J/(kg K)."""

    def properties(self) -> MaterialProperties:
        return MaterialProperties(self.rho, self.E, self.nu, self.alpha, self.k, self.c)


_MEANING = {
    "rho": "density, kg/m3", "E": "Young's modulus, Pa", "nu": "Poisson's ratio",
    "alpha": "thermal expansion, 1/K", "k": "conductivity, W/(m K)", "c": "specific heat, J/(kg K)",
}


@dataclass(frozen=True, slots=True)
class Constants:
    """Properties of a material at one temperature: rho, kg/m3, E, Pa, nu, alpha, 1/K, k, W/(m K),
    c, J/(kg K), None for one that is not given; by_direction: those that depend on the direction,
    in the place of E, nu, alpha, k, None for an isotropic material."""

    rho: float
    E: float | None
    nu: float | None
    alpha: float
    k: float | None
    c: float | None
    by_direction: DirectionalProperties | None = None

    def directional(self) -> DirectionalProperties | None:
        """As `Material.directional`."""
        return self.by_direction


def constants_at(material: Material, temperature: float) -> Constants:
    """Properties of a material at a temperature, K."""
    def value(of: float | TemperatureProperty | None) -> float | None:
        if isinstance(of, TemperatureProperty):
            return float(of.at(np.array([temperature]))[0][0])
        return None if of is None else float(of)

    p = material.properties()
    return Constants(
        float(p.rho), value(p.E), p.nu, value(p.alpha) or 0.0, value(p.k), value(p.c),
        material.directional())


def curves(material: Material) -> dict[str, TemperatureProperty]:
    """Properties of a material that are functions of temperature, by name."""
    p = material.properties()
    values = {"E": p.E, "alpha": p.alpha, "k": p.k, "c": p.c}
    return {n: v for n, v in values.items() if isinstance(v, TemperatureProperty)}


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Cells of a body with one material, None for all. name: their set, "" for the others;
    constants: properties at the reference temperature."""

    material: Material
    constants: Constants
    cells: IntArray | None = None
    name: str = ""


def regions_of(
    mesh: Mesh, material: Material, others: Mapping[str, Material], temperature: float
) -> tuple[Region, ...]:
    """Materials of all cells: `others` in the cells of the set of that name, `material` elsewhere.
    temperature: reference temperature, K.

    InputError under the name of a set that does not exist, contains no cell, or shares cells with
    another one.
    """
    if not others:
        return (Region(material, constants_at(material, temperature)),)
    owner, found = np.zeros(len(mesh.cells), np.int64), list[Region]()
    faults = []
    for number, (name, other) in enumerate(others.items(), 1):
        if name not in mesh.point_sets:
            faults.append(Fault(name, f"the mesh has no set {name!r}: "
                                f"{suggestions(name, sorted(mesh.point_sets), 'sets')}"))
            continue
        inside = cells_of_set(mesh, name)
        if not inside.any():
            faults.append(Fault(name, "no cell of the mesh has all its points in this set"
                                if name not in mesh.facet_sets else
                                "this set consists of surfaces, edges or points, not of cells"))
        shared = np.unique(owner[inside])
        if shared.any():
            before = list(others)[int(shared.max()) - 1]
            faults.append(Fault(name, f"{int(np.count_nonzero(owner[inside]))} cells are in the "
                                f"set {before!r} as well: a cell has one material"))
        owner[inside] = number
        found.append(Region(other, constants_at(other, temperature), np.flatnonzero(inside), name))
    if faults:
        raise InputError(faults)
    rest = np.flatnonzero(owner == 0)
    first = [Region(material, constants_at(material, temperature), rest)] if len(rest) else []
    return (*first, *found)


def cells_of_set(mesh: Mesh, name: str) -> BoolArray:
    """(E,) True for the cells of a set: those that the mesh tags; where it tags neither cells nor
    facets, those with all points in the set."""
    if name not in mesh.cell_sets and name not in mesh.facet_sets:
        return np.asarray(np.isin(mesh.cells, mesh.point_sets[name]).all(axis=1))
    inside = np.zeros(len(mesh.cells), dtype=np.bool_)
    inside[mesh.cell_sets.get(name, [])] = True
    return inside


def summed(regions: Sequence[Region], make: Callable[[Region], Csr]) -> Csr:
    """Sum of the matrices of all regions."""
    total = make(regions[0])
    for region in regions[1:]:
        total = total + make(region)
    return total


def require(constants: Constants, names: Sequence[str], field: str) -> tuple[float, ...]:
    """Values of the constants `names`, without those that depend on the direction; InputError that
    names all missing ones."""
    values: dict[str, float | None] = {name: getattr(constants, name) for name in names}
    of = constants.directional()
    by_direction = () if of is None else (
        *(("E", "nu") if of.stiffness is not None else ()),
        *(("k",) if of.conductivity is not None else ()))
    missing = [n for n, value in values.items() if value is None and n not in by_direction]
    if missing:
        raise InputError(
            [Fault(name, f"missing: the {field} field needs it ({_MEANING[name]})")
             for name in missing]
        )
    return tuple(float(v) for v in values.values() if v is not None)
