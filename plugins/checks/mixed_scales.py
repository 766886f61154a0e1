"""Notes on temperatures that differ by the offset of degrees Celsius from others of the model."""

from collections.abc import Iterator

import numpy as np

from sparsemor.core import Check, Level, Model, Note, Quantity, Scene
from sparsemor.plugins.checks import place

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
            if shape.eliminated_temperature is not None:
                yield (f"the initial temperature of {name}",
                       float(shape.eliminated_temperature.min()))
    for name, part in model.connectors.items():
        if part.surroundings is not None:
            T = float(part.surroundings(0.0))
            if np.isfinite(T):
                yield f"the temperature of {name}", T
