"""Places, temperatures and displacements that are almost surely a mistake, and bodies that nothing
holds."""

from collections.abc import Iterator

import numpy as np

from sparsemor.core import (
    Body,
    Check,
    Findings,
    FloatArray,
    Model,
    Note,
    Plugin,
    PreparedRun,
    Quantity,
    RunResult,
    Scene,
    information,
    step_count,
)
from sparsemor.core.model.assembly import mentioned
from sparsemor.core.protocols.mesh import outside_box_notes
from sparsemor.plugins.checks import place

HOTTEST = 1e4
"""Temperature, K, above which there is a warning: no solid is that hot, tungsten melts at 3 695
K."""
COLDEST = 50.0
"""Initial temperature, K, above which temperatures are taken as absolute. Temperatures that start
at 0 are changes, for which the discretisation may undershoot 0."""
ROUND, BEYOND = 1e-6, 1e-3
"""Temperature difference, K, and share of a property's finite range by which that may be exceeded
without a warning: a reduced run does so by its error, where its temperatures begin at a limit."""
STORED, LARGE = 8, 20_000
"""Number of stored steps at which a block is checked, and number of unknowns above which only the
last one is."""


class Plausibility(Check):
    """Places, temperatures and displacements that are almost surely a mistake."""

    order = place("plausibility")

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        return () if model is None else (
            *distant_probes(scene, model), *start_temperatures(model),
            *prescribed_temperatures(scene, model))

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(() if run.model is None else after_run(run.model, result))


def after_run(model: Model, result: RunResult) -> tuple[Note, ...]:
    """Warnings about results outside the validity of the equations: temperatures that no solid has,
    displacements larger than the body's smallest extent."""
    found: list[Note] = []
    # bodies whose equations hold for large displacements
    nonlinear = {m.name for m in model.separated.moving if m.operators is not None and (
        s := m.operators.stress_stiffness) is not None and s.nonlinear and (
            not s.prestressed)}
    for name, shape in model.shapes().items():
        heated, moved = (result.layout.of(name, q) for q in (
            Quantity.TEMPERATURE, Quantity.DISPLACEMENT))
        if heated is not None:
            T = result.block(heated.name, checked_steps(result, heated.name))
            absolute = bool((np.abs(model.x0[model.layout[heated.name]]) > COLDEST).any())
            # temperatures that begin at 0 are changes and may fall below it
            found += temperature_notes(f"temperatures of {name}", T, 0.0 if absolute else 1.0)
            found += property_notes(model.bodies[name], T)
        if moved is not None:
            largest = max(float(np.linalg.norm(result.nodal_displacement(name, int(i)), axis=1)
                                .max()) for i in checked_steps(result, moved.name))
            extent = float(np.ptp(shape.points, axis=0).min())
            if largest > extent and name not in nonlinear:
                found.append(Note(
                    f"displacements of {name} reach {largest:.3g} m, {largest / extent:.2g} times "
                    f"its smallest extent of {extent:.3g} m: linear elasticity does not hold "
                    f"there; take bodies.{name}.strains: nonlinear, or check E, the thickness and "
                    "the loads", "large_displacement"))
    return tuple(found)


def property_notes(body: Body, T: FloatArray) -> Iterator[Note]:
    """Warnings about temperatures T (K) outside the range in which a material property of the body
    is defined."""
    values = T[np.isfinite(T)]
    for key, (low, high) in body.temperature_limits.items() if values.size else ():
        coldest, hottest = float(values.min()), float(values.max())
        worst = hottest if hottest - high > low - coldest else coldest
        beyond = max(ROUND, BEYOND * (high - low) if np.isfinite(high - low) else 0.0)
        if coldest < low - beyond or hottest > high + beyond:
            yield Note(f"bodies.{body.name}.{key} is defined from {low:g} to {high:g} K, and "
                       f"temperatures of {body.name} reach {worst:.5g} K: it is constant outside",
                       "property_range")


def distant_probes(scene: Scene, model: Model) -> Iterator[Note]:
    """Warnings about probes outside their body: the nearest node is recorded instead."""
    for name, shape in model.shapes().items():
        for key, probe in scene.probes.items():
            if probe.body == name and not isinstance(probe.at, str):
                yield from outside_box_notes(f"probes.{key}", probe.at, shape.points)


def start_temperatures(model: Model) -> Iterator[Note]:
    """Warnings about initial temperatures that no solid has."""
    for block in model.layout:
        if block.kind.quantity is Quantity.TEMPERATURE:
            yield from temperature_notes(
                f"initial temperatures of {block.owner}", model.x0[model.layout[block.name]])


def prescribed_temperatures(scene: Scene, model: Model) -> Iterator[Note]:
    """Warnings about prescribed temperatures that no solid has, at up to a thousand times of the
    run."""
    times = np.linspace(0.0, scene.time.end, min(step_count(scene), 1000) + 1)
    for name, shape in model.shapes().items():
        if shape.given:
            yield from temperature_notes(f"prescribed temperatures of {name}",
                                         shape.given_at(times) @ shape.given_shapes.T)


def temperature_notes(what: str, T: FloatArray, undershoot: float = 0.0) -> list[Note]:
    """Warnings about temperatures T (K) below 0 by more than the share `undershoot` of the highest
    one, or above `HOTTEST`; what: their name in the text."""
    values = T[np.isfinite(T)]
    if not values.size:
        return []
    low, high, found = float(values.min()), float(values.max()), list[Note]()
    if low < min(-undershoot * high, 0.0):
        found.append(Note(f"{what} are in K and fall to {low:.4g} K, below absolute zero",
                          "impossible_temperature"))
    if high > HOTTEST:
        found.append(Note(f"{what} reach {high:.3g} K: no solid is that hot (above {HOTTEST:g} K); "
                          "check the heat, the thickness and the material",
                          "impossible_temperature"))
    return found


def checked_steps(result: RunResult, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Stored steps at which a block is checked; for a reduced block those of the largest
    coefficients and the last."""
    last = len(result.times) - 1
    if result.reduced(name):
        size = np.linalg.norm(result.coefficients(name), axis=1)
        return np.unique([int(np.nan_to_num(size).argmax()), last])
    large = next(b.size for b in result.layout if b.name == name) > LARGE
    return np.unique(np.linspace(last if large else 0, last, STORED).astype(np.int64))


GROUND = ""


class UnheldBodies(Check):
    """Bodies that nothing holds."""

    order = place("unheld_bodies")

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        return () if model is None else unheld_bodies(scene, model)


def unheld_bodies(scene: Scene, model: Model) -> tuple[Note, ...]:
    """Warning about bodies that are free although others are held, as with a joint that is missing;
    information where no body is held, and the free ones start at rest under loads.

    Connections are the names of bodies in the options of joints and contacts; one that names a
    single body holds it. A body whose frame is no unknown is held.
    """
    frames = {b.owner: b for b in model.layout if b.kind.quantity is Quantity.POSE}
    bodies = [name for name in scene.bodies if name in frames]
    # name of the group of connected bodies to which each belongs; that of the ground is ""
    group = {name: name for name in bodies} | {GROUND: GROUND}
    connectors = [*scene.joints.values(), *scene.contacts.values()]
    for connector in connectors:
        if connector.acts_on == "temperature":
            continue
        named = mentioned(connector, scene.bodies)
        ends = {name if name in frames else GROUND for name in named}
        ends |= {GROUND} if len(named) == 1 else set()
        joined = {group[e] for e in ends}
        group = {name: min(joined) if g in joined else g for name, g in group.items()}
    free = [name for name in bodies if group[name] != group[GROUND]]
    if not free:
        return ()
    names, many = " and ".join(free), len(free) > 1
    if len(free) < len(bodies):
        return (Note(
            f"{names} {'hang' if many else 'hangs'} on nothing: no joint, contact or prescribed "
            f"motion connects {'them' if many else 'it'} with the ground, as the other bodies "
            "are; is a joint missing?", "unheld_body"),)
    v = model.v0
    moves = any(np.any(v[model.layout[frames[n].name]]) for n in free)
    pushed = any(mentioned(load, scene.bodies) or not _names_bodies(load)
                 for load in scene.loads.values()
                 if load.acts_on == "motion")
    if connectors or moves or not pushed:
        return ()
    return (information(
        f"no joint, contact or prescribed motion holds {names}, at rest at the start: the loads "
        "will drive it away; a body that is to stay in its place takes `frame: fixed`",
        "unheld_body"),)


def _names_bodies(load: object) -> bool:
    """True if a load has an option for the sets or bodies on which it acts."""
    return isinstance(load, Plugin) and bool({"on", "of", "body", "between"} & set(
        type(load).model_fields))
