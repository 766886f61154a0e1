"""Numbers of a scene in another unit than the SI's: a modulus in GPa, a density in g/cm3, a
thickness in millimetres, an angle in degrees, temperatures in degrees Celsius among others in
kelvin."""

from collections.abc import Iterator, Mapping
from math import pi, radians
from typing import Any

import numpy as np

from sparsemor.core import Check, Level, Model, Note, Quantity, Scene
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
        # a thickness of 1 m is meant where results are those per metre of depth
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
    """Notes on a material that no solid has: E, Pa, written in GPa or MPa, or rho, kg/m3, in g/cm3.
    """
    E, rho = float(material["E"]), float(material["rho"])
    if rho >= DENSE and 0.0 < E < SOFT * rho:
        factor, unit = (1e9, "GPa") if E < 1e3 else (1e6, "MPa")
        yield Note(f"{key}.E is {E:g} Pa at a density of {rho:g} kg/m3, and no solid is so soft: "
                   f"if {unit} are meant, write {factor * E:g}", UNIT)
    if LIGHT[0] < rho < LIGHT[1] and E > FAST * rho:
        yield Note(f"{key}.rho is {rho:g} kg/m3 with E = {E:.3g} Pa, and no solid is so light and "
                   f"stiff: if g/cm3 are meant, write {1e3 * rho:g}", UNIT)


OFFSET = 273.15
"""0 degrees Celsius, K."""
ROOM = 250.0, 450.0
"""Temperatures, K, of which at least one shows that a model is in kelvin."""
LOWEST, UNLIKELY, COLD = 5.0, 150.0, 240.0
"""Temperatures between the first and the last, K, are noted in such a model; below the second with
a warning. Below the first are temperatures relative to a start, and outer space."""
NITROGEN = 77.36, 1.0
"""Boiling temperature of nitrogen, K, and its tolerance: no mistake."""


class MixedScales(Check):
    """Temperatures in degrees Celsius among others in kelvin."""

    order = place("mixed_scales")

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        return () if model is None else tuple(mixed_scales(model))


def mixed_scales(model: Model) -> Iterator[Note]:
    """Notes on initial, stress-free, prescribed, fluid and ambient temperatures, at the start, that
    are below `COLD` although another is that of a room: 20 or 60 next to 293.15 K. None where a
    load has such a note."""
    if any(n.kind == "celsius" for part in model.parts.values() for n in part.notes):
        return
    found = dict(_temperatures(model))
    room = [(what, T) for what, T in found.items() if ROOM[0] <= T <= ROOM[1]]
    if not room:
        return
    for what, T in found.items():
        if LOWEST < T < COLD and abs(T - NITROGEN[0]) > NITROGEN[1]:
            level = Level.WARNING if T < UNLIKELY else Level.INFORMATION
            yield Note(f"{what} is {T:g} K, which is {T - OFFSET:.4g} degrees Celsius, and "
                       f"{room[0][0]} is {room[0][1]:.5g} K: if {T:g} degrees Celsius are meant, "
                       f"write {T + OFFSET:g}", "celsius", level)


def _temperatures(model: Model) -> Iterator[tuple[str, float]]:
    """Temperatures, K, at the start and what they are."""
    for block in model.layout:
        if block.kind.quantity is Quantity.TEMPERATURE and block.size:
            yield (f"the initial temperature of {block.owner}",
                   float(model.x0[model.layout[block.name]].min()))
    for name, shape in model.shapes().items():
        if shape.stress is not None:
            yield f"the reference temperature of {name}", float(shape.stress.free.min())
            if shape.eliminated_temperature is not None:  # constant, and no unknown
                yield (f"the initial temperature of {name}",
                       float(shape.eliminated_temperature.min()))
    for name, part in model.connectors.items():
        if part.surroundings is not None:
            T = float(part.surroundings(0.0))
            if np.isfinite(T):
                yield f"the temperature of {name}", T
