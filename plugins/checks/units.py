"""Numbers of a scene in another unit than the SI's: a modulus in GPa, a density in g/cm3, a
thickness in millimetres, an angle in degrees."""

from collections.abc import Iterator, Mapping
from math import pi, radians
from typing import Any

import numpy as np

from sparsemor.core import Check, Model, Note, Scene
from sparsemor.core.protocols.poses import in_degrees
from sparsemor.plugins.checks import place

UNIT = "unlikely_unit"
"""Kind of the notes."""
DENSE, SOFT = 2000.0, 100.0
"""Density, kg/m^3, from which no solid has a ratio E/rho below the second, m^2/s^2: waves slower
than 10 m/s, against 1200 m/s in lead."""
LIGHT, FAST = (0.5, 25.0), 9.0e8
"""Densities that solids have in g/cm^3, and a ratio E/rho, m^2/s^2, that none has: waves faster
than 30 km/s, against 18 km/s in diamond."""
THICK = 5.0
"""Ratio of the thickness of a plane body to its largest extent above which there is a note, unless
the thickness is 1 m, as for forces per metre."""


class Units(Check):
    """Numbers that are likely in another unit than the SI's."""

    order = place("units")

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        extents = {} if model is None else {
            name: float(np.ptp(shape.points, axis=0).max())
            for name, shape in model.shapes().items() if shape.elastic_dofs is not None}
        return tuple(unlikely_units(scene.dump().get("bodies", {}), extents))


def unlikely_units(bodies: Mapping[str, Any], extents: Mapping[str, float]) -> Iterator[Note]:
    """Warnings about the options of bodies; extents: of the flexible ones, m."""
    for name, body in bodies.items():
        for key, material in _materials(body, f"bodies.{name}"):
            yield from _material(key, material)
        thickness, extent = body.get("thickness"), extents.get(name)
        if thickness and extent and thickness != 1.0 and thickness > THICK * extent:
            yield Note(
                f"bodies.{name}.thickness is {thickness:g} m, {thickness / extent:.2g} times the "
                f"largest extent of {extent:.3g} m, and a plane body is thin: if millimetres are "
                f"meant, write {1e-3 * thickness:g}", UNIT)
        angle = (body.get("pose") or {}).get("angle", 0.0)
        if in_degrees(angle):
            yield Note(f"bodies.{name}.pose.angle is {angle:g} rad, {abs(angle) / (2 * pi):.3g} "
                       f"turns: if degrees are meant, write {radians(angle):.6g}", UNIT)


def _materials(options: Mapping[str, Any], key: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Mappings with constant E and rho, at any depth, and their keys."""
    if all(isinstance(options.get(n), int | float) for n in ("E", "rho")):
        yield key, options
    for name, value in options.items():
        if isinstance(value, Mapping):
            yield from _materials(value, f"{key}.{name}")


def _material(key: str, material: Mapping[str, Any]) -> Iterator[Note]:
    E, rho = float(material["E"]), float(material["rho"])
    if rho >= DENSE and 0.0 < E < SOFT * rho:
        factor, unit = (1e9, "GPa") if E < 1e3 else (1e6, "MPa")
        yield Note(f"{key}.E is {E:g} Pa at a density of {rho:g} kg/m3, and no solid is so soft: "
                   f"if {unit} are meant, write {factor * E:g}", UNIT)
    if LIGHT[0] < rho < LIGHT[1] and E > FAST * rho:
        yield Note(f"{key}.rho is {rho:g} kg/m3 with E = {E:.3g} Pa, and no solid is so light and "
                   f"stiff: if g/cm3 are meant, write {1e3 * rho:g}", UNIT)
