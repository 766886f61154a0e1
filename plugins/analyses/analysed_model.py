"""Models of analyses: assembled, with the trial bases of the scene's reducer; their equilibrium,
and their steady temperatures: the heat equations without rates, K_T(T) T + q(T) = f, by Newton's
method.

Radiation, convection, conductivity that depends on temperature and conduction through joints and
contacts are terms of the model, with their own tangents; bodies stand as at the start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csgraph, csr_array

from sparsemor.core import Dictionary, InputError, Quantity, Scene, State, StepFactors
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.core.model.model import Model
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.controllers import controllers_of
from sparsemor.core.simulation.stages_before_steps import build_bases, explicit, prepared, train
from sparsemor.plugins.analyses.analysed_equations import System
from sparsemor.plugins.analyses.equilibrium import SolvedState, flow, free_motions, newton
from sparsemor.plugins.analyses.steady_motion import assembled, spinning


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A scene for an analysis: its equations, and its bodies for other models of it."""

    scene: Scene
    system: System
    bodies: BodyCache

    @property
    def model(self) -> Model:
        return self.system.model


def prepare(scene: Scene, observers: Sequence[object] = (), cache: Cache | None = None) -> Prepared:
    """Equations of a scene, at full order or in the trial spaces of its reducer, which are trained
    if they need it. Raises InputError and SolveFailed as a run before its first step."""
    if scene.rigid_stage is not None:
        raise InputError("an analysis solves for the whole mechanism: drop rigid_stage",
                         "rigid_stage")
    if found := controllers_of(scene):
        key = next(iter(found))
        raise InputError("a controller acts in the steps of a run only: give a function of time",
                         key)
    cache, bodies = cache or Cache(), BodyCache()
    manager = new_manager(observers)
    scene = explicit(scene, cache, manager, bodies)  # with a reducer that is chosen for it
    model, offline = prepared(scene, cache, manager, bodies)
    # friction with a memory adds unknowns of first order
    sticks = [b.owner for b in model.layout if b.kind.order == 1
              and b.kind.quantity is not Quantity.TEMPERATURE]
    if sticks:
        raise InputError("surfaces that stick have no equilibrium of their own, because it depends "
                         "on their history: take `coulomb` or no friction, or run it in time",
                         f"contacts.{sticks[0]}.friction")
    train(scene, model, offline)
    build_bases(scene, model, offline)
    h = scene.time.step
    factors = StepFactors(h, *scene.integrator.rules(h).factors)
    bases: dict[str, Dictionary] = {
        name: offline.dictionary(name, basis, factors)[0]
        for name, basis in fitted_bases(model, scene.reducer).bases.items()}
    return Prepared(scene, System.from_model(model, bases), bodies)


def time_of(scene: Scene, at: float | None) -> float:
    """Time of the loads, s: the end of the scene where none is given. Raises InputError."""
    if at is None:
        return scene.time.end
    if not (np.isfinite(at) and at >= 0.0):
        raise InputError(f"must be a time from 0 s on (got {at:g})", "at")
    return float(at)


def rates(p: Prepared, spin: bool) -> Callable[[State], State]:
    """Gives a state its rates: none at rest, those of steady rotation with `spin`."""
    if not spin:
        return lambda s: s

    def moving(s: State) -> State:
        v, a = spinning(p.system, s, p.scene.time.step)
        return replace(s, v=v, a=a)

    return moving


def equilibrium(p: Prepared, t: float, spin: bool) -> SolvedState:
    """Equilibrium of all bodies and joints under the loads at the time t (s), with temperatures of
    the start; spin: in steady rotation. Raises SolveFailed where there is none."""
    system = p.system
    start, at = assembled(system, system.start(t)), system.mechanical
    if not len(at):
        raise InputError("no body of this scene moves or deforms: take steady_heat", "bodies")
    if spin:
        return newton(system, start, at, rates(p, True))
    if free_motions(system, start).shape[1]:  # the tangent may be singular on the way
        return flow(system, start, at)
    return newton(system, start, at)


SINK = 1e-11
"""Heat per kelvin that leaves a group of bodies, relative to that between its nodes, below which
nothing leaves."""


def steady_heat(p: Prepared, *, at: float | None = None) -> SolvedState:
    """Steady temperatures under the heat loads at a time, s. Raises InputError for bodies that no
    heat can leave, SolveFailed where the iteration does not converge."""
    system = p.system
    rows = system.thermal
    if not len(rows):
        raise InputError("no body of this scene has a thermal field", "bodies")
    start = system.start(time_of(p.scene, at))
    _check_sinks(System.from_model(p.model, {}), start.t)
    return newton(system, start, rows)


def _check_sinks(system: System, t: float) -> None:
    """Raises InputError with the bodies whose heat can go nowhere: rows of their tangent sum to
    zero. leaves: W/K, sum of all entries of the bodies that exchange heat; between: that of their
    magnitudes."""
    layout, rows = system.layout, system.thermal
    K = csr_array(system.jacobian(system.start(t))[rows][:, rows])
    count, label = csgraph.connected_components(K, directed=False)
    leaves = np.bincount(label, np.asarray(K.sum(axis=1)).ravel(), count)
    between = np.bincount(label, np.asarray(abs(K).sum(axis=1)).ravel(), count)
    for i in np.flatnonzero(np.abs(leaves) <= SINK * between):
        names = [layout.block(n).owner for n in layout.containing(rows[label == i])]
        word = "them" if len(names) > 1 else "it"
        raise InputError(
            f"no heat leaves {' and '.join(names)}, so that no steady temperature exists: give "
            f"{word} convection, radiation, a prescribed temperature, or a joint or contact that "
            "conducts to a body with one", f"bodies.{names[0]}")
