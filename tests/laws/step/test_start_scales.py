"""The start of a run has no scale of its own: units, places and frequencies do not change it."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import ReducedProblem, ReducedTerm, State, Term, Trial
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.constraint_rates import Constraints
from sparsemor.core.model.initial_state import consistent_state, start_notes
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import scene_of

H = 1e-3
SPIN, HINGE = np.array([0.0, 7.0, 0.0]), np.array([0.0, 0.05, 0.04])


def listed(v: FloatArray) -> list[float]:
    return [float(c) for c in v]


def chain(unit: float = 1.0, moved: float = 0.0, reducer: Any = "full") -> dict[str, Any]:
    """Two flexible bars that spin on a hinge and a weld, the first of them driven; `unit` of time,
    s, and a distance `moved` of the whole scene, m."""
    place = np.array([moved, -moved, 0.5 * moved])
    def bar(x: float) -> dict[str, Any]:
        at = np.array([x, 0.0, 0.0])
        velocity = np.cross(SPIN, at - HINGE) * unit
        return {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
                "mesh": BlockMesh(size=(0.4, 0.1, 0.08), divisions=(2, 1, 1)),
                "material": {"E": 5e8 * unit**2, "nu": 0.3, "rho": 1000.0},
                "pose": {"position": listed(place + at), "spin": listed(SPIN * unit),
                         "velocity": listed(velocity)}}

    drive = {"use": "sine", "amplitude": 0.07, "frequency": 50.0 / np.pi * unit}  # 7 rad/s at 0
    return {
        "bodies": {"one": bar(0.0), "two": bar(0.4)},
        "joints": {
            "A": {"use": "revolute", "between": ["ground", "one:left"], "axis": [0, 1, 0]},
            "B": {"use": "fixed", "between": ["one:right", "two:left"]},
            "C": {"use": "prescribed_motion", "of": "one:left", "axis": [0, 1, 0],
                  "angle": drive}},
        "loads": {"g": {"use": "gravity", "g": [0.0, -3.0 * unit**2, -9.81 * unit**2]}},
        "integrator": "generalized_alpha", "reducer": reducer,
        "time": {"end": 2 * H / unit, "step": H / unit}}


def start(tree: dict[str, Any]) -> tuple[Model, State]:
    """As the step solver of the scene's reducer has it."""
    scene = scene_of(tree)
    model = assemble(scene)
    return model, begun(scene, model)


def begun(scene: Scene, model: Model) -> State:
    solver: Any = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, {}),
        np.random.default_rng(0)))
    state: State = solver.start(consistent_state(model))[0]
    return state


def forces(state: State, model: Model) -> FloatArray:
    """All multipliers, which come last."""
    count = model.layout.size - model.layout.algebraic.start
    return state.x[-count:]


FULL: Any = "full"
ATOMS: Any = {"use": "galerkin", "basis": {"use": "modal", "count": 12}}


@pytest.mark.full
@pytest.mark.parametrize("reducer", [FULL, ATOMS], ids=["full", "galerkin"])
@pytest.mark.parametrize("unit", [1e-5, 1e5])
def test_a_unit_of_time_does_not_change_the_start(unit: float, reducer: Any) -> None:
    model, want = start(chain(reducer=reducer))
    other, got = start(chain(unit, reducer=reducer))
    force, a = forces(want, model), want.a
    assert np.abs(force).max() > 1
    got_force, limit = forces(got, other) / unit**2, 1e-8 * np.abs(force).max()
    np.testing.assert_allclose(got_force, force, rtol=0, atol=limit)
    np.testing.assert_allclose(got.a / unit**2, a, rtol=0, atol=1e-7 * np.abs(a).max())
    assert start_notes(model) == start_notes(other) == ()


def driven(frequency: float, phase: float, which: str) -> Model:
    """A rigid body of 2 kg, or 0.02 kg m^2 about y, that follows a sine of 1 mm, or 1 mrad, in
    steps of a hundredth of its period. At rest at the start where the phase is pi / 2."""
    motion = {"use": "sine", "amplitude": 1e-3, "frequency": frequency, "phase": phase,
              "offset": -1e-3 * np.sin(phase)}
    body: dict[str, Any] = {"use": "rigid", "mass": 2.0, "inertia": [0.01, 0.02, 0.03],
                            "points": {"hub": [0.0, 0.0, 0.0]}}
    joints: dict[str, Any] = {"drive": {"use": "prescribed_motion", "of": "body:hub"}}
    if which == "plane":
        body |= {"inertia": 0.02, "points": {"hub": [0.0, 0.0]}}
        joints["drive"] |= {"x": motion}
    elif which == "x":
        joints["drive"] |= {"x": motion}
    else:
        joints["drive"] |= {"angle": motion, "axis": [0, 1, 0]}
        joints["hinge"] = {"use": "revolute", "between": ["ground", "body:hub"], "axis": [0, 1, 0]}
    return assemble(scene_of({
        "bodies": {"body": body}, "joints": joints, "integrator": "generalized_alpha",
        "time": {"end": 0.1 / frequency, "step": 0.01 / frequency}}))


@pytest.mark.parametrize("which", ["plane", "x", "angle"])
@pytest.mark.parametrize("frequency", [1e-3, 100.0, 1e6])
def test_the_force_of_a_driven_body_is_exact_and_no_start_is_noted(
    which: str, frequency: float
) -> None:
    model = driven(frequency, np.pi / 2, which)
    state = consistent_state(model)
    size = 0.02 if which == "angle" else 2.0
    force = state.x[model.layout["drive.multiplier"]][0]
    want = size * 1e-3 * (2 * np.pi * frequency) ** 2
    assert abs(force) == pytest.approx(want, rel=1e-9)
    assert start_notes(model) == ()


@pytest.mark.parametrize("which", ["plane", "x", "angle"])
@pytest.mark.parametrize("frequency", [1e-3, 1e4])
def test_a_motion_that_begins_with_a_velocity_is_noted(which: str, frequency: float) -> None:
    (note,) = start_notes(driven(frequency, 0.0, which))
    rate = 1e-3 * 2 * np.pi * frequency
    assert note.kind == "start" and f"break joint drive by {rate:.3g} m/s or rad/s" in note.text


class Opaque(Term):
    """A term that does not say how it depends on time."""

    def __init__(self, term: Term) -> None:
        self.term, self.rows, self.columns = term, term.rows, term.columns

    def residual(self, *at: Any) -> FloatArray:
        return self.term.residual(*at)

    def jacobian(self, *at: Any) -> Any:
        return self.term.jacobian(*at)

    def restrict(self, keep: IntArray) -> "Opaque":
        return Opaque(self.term.restrict(keep))

    def compress(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        return self.term.compress(trial, left)


@pytest.mark.full
def test_terms_that_do_not_know_their_time_derivatives_are_differenced() -> None:
    model = assemble(scene_of(chain()))
    at = model.x0, model.v0, 0.0
    known = Constraints.from_terms(model.layout, model.terms, H)
    other = Constraints.from_terms(model.layout, tuple(map(Opaque, model.terms)), H)
    want = known.curvature(*at)
    assert np.abs(want).max() > 10.0  # centrifugal
    np.testing.assert_allclose(other.curvature(*at), want, rtol=0, atol=1e-6 * np.abs(want).max())
    for got, exact in zip(other.rate(*at), known.rate(*at), strict=True):
        np.testing.assert_allclose(got, exact, rtol=0, atol=1e-6)
