"""Static friction: blocks that stay, start, slide, jerk, and the heat of their slip."""

from math import atan, cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pressed_slider import BOTH, LOAD
from pressed_slider import scene as slider
from reduced_runs import decoded, learnt
from sparsemor import simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of

G, MU, GIVE = 9.81, 0.3, 1e-6
MASS, DEPTH = 0.1, 4.905e-8
"""Mass of the block, kg, and its penetration at rest on a level plate, m."""
STICK = {"use": "stick", "coefficient": MU, "displacement": GIVE}
RUBS = {"use": "coulomb", "coefficient": MU, "critical_velocity": 1e-3}


def block(d: int, lower: list[float], size: list[float], divisions: list[int],
          **options: Any) -> dict[str, Any]:
    axes = [0, 2] if d == 2 else [0, 1, 2]
    lower, size, divisions = ([v[i] for i in axes] for v in (lower, size, divisions))  # type: ignore
    mesh = {"use": "rectangle" if d == 2 else "block", "lower": lower, "size": size,
            "divisions": divisions}
    return {"use": "flexible", "mesh": mesh, "fields": [],
            "material": {"rho": 1000.0, "k": 50.0, "c": 500.0},
            **({"thickness": 0.02} if d == 2 else {}), **options}


def on_a_plate(
    friction: dict[str, Any], end: float, step: float, *, d: int = 2, slope: float = 0.0,
    velocity: float = 0.0, loads: dict[str, Any] | None = None, fields: tuple[str, ...] = (),
    integrator: Any = "bdf1", heat: dict[str, Any] | None = None, **options: Any,
) -> Scene:
    """A block at rest, or with a velocity, on a plate that is turned by an angle."""
    along, up = np.array([cos(slope), sin(slope)]), np.array([-sin(slope), cos(slope)])
    places = [-DEPTH * cos(slope) * up, velocity * along]
    position, speed = ([float(p[0]), *([0.0] if d == 3 else []), float(p[1])] for p in places)
    turned: dict[str, Any] = {"angle": slope} if d == 2 else {
        "quaternion": [cos(slope / 2), 0.0, -sin(slope / 2), 0.0]}
    box = block(d, [-0.05, -0.01, 0.0], [0.1, 0.02, 0.05], [2, 1, 1], fields=list(fields),
                pose={"position": position, "velocity": speed, **turned})
    plate = block(d, [-2.0, -1.0, -0.2], [4.0, 2.0, 0.2], [4, 2, 1], frame="fixed", pose=turned,
                  fields=list(fields))
    sole = {"use": "polygonal", "between": ["block:bottom", "plate:top"], "friction": friction,
            "normal": {"use": "elastic_foundation", "stiffness": 1e10, "damping": 1e6,
                       "damping_depth": 1e-8}, **({"heat": heat} if heat else {})}
    down = [0.0, -G] if d == 2 else [0.0, 0.0, -G]
    return scene_of({
        "bodies": {"block": box, "plate": plate}, "contacts": {"sole": sole},
        "loads": {"weight": {"use": "gravity", "g": down}, **(loads or {})},
        "time": {"end": end, "step": step}, "integrator": integrator, **options})


def travelled(run: March, slope: float = 0.0) -> FloatArray:
    """(T,) distance along the plate, m."""
    x = run.block("block.rigid")
    at = x[:, [0, 1]] if len(x[0]) == 3 else x[:, [0, 2]]
    return np.asarray((at - at[0]) @ [cos(slope), sin(slope)])


@pytest.mark.full
@pytest.mark.parametrize(("d", "integrator"), [(2, "bdf1"), (2, "bdf2"), (3, "bdf1")])
def test_a_block_stays_on_a_slope_below_the_angle_of_friction(d: int, integrator: str) -> None:
    """After it has come to rest, displaced by its share of the elastic displacement, it stays to
    round-off; under a regularised law it creeps."""
    slope = atan(0.9 * MU)
    end = 0.05 if integrator == "bdf1" else 0.3
    run = march(on_a_plate(STICK, end, 1e-3, d=d, slope=slope, integrator=integrator))
    s = travelled(run, slope)
    rest = s[len(s) // 2]
    assert 0.9 * GIVE < -rest < 20.0 * GIVE
    assert np.abs(s[len(s) // 2 :] - rest).max() < (1e-6 if integrator == "bdf1" else 1e-2) * GIVE
    z = run.block("sole.bristles").reshape(len(s), -1, d)[-1]
    assert np.abs(np.linalg.norm(z, axis=1)).max() <= GIVE * (1.0 + 1e-4)
    if integrator == "bdf1" and d == 2:
        creeps = travelled(march(on_a_plate(RUBS, end, 1e-3, slope=slope)), slope)
        assert creeps[-1] - creeps[len(s) // 2] < -10.0 * GIVE


@pytest.mark.full
@pytest.mark.parametrize(("d", "integrator"), [(2, "bdf1"), (3, "generalized_alpha")])
def test_above_that_angle_it_slides(d: int, integrator: str) -> None:
    slope = atan(1.1 * MU)
    run = march(on_a_plate(STICK, 0.05, 1e-3, d=d, slope=slope, integrator=integrator))
    late = run.t > 0.025
    x, t = travelled(run, slope)[late], run.t[late]
    a = -2.0 * np.polyfit(t, x, 2)[0]
    assert a == pytest.approx(G * (sin(slope) - MU * cos(slope)), rel=1e-3)


@pytest.mark.full
def test_a_pushed_block_starts_at_the_limit_of_friction() -> None:
    """A force that rises to 1.5 mu N within the run."""
    limit, end = MU * MASS * G, 0.3
    push = {"push": {"use": "point_force", "on": "block:bottom", "force": [1.5 * limit, 0.0],
                     "factor": {"use": "ramp", "end": end, "final": 1.0}}}
    run = march(on_a_plate(STICK, end, 1e-3, loads=push))
    s, force = travelled(run), 1.5 * limit * run.t / end
    assert s[force < 0.99 * limit].max() <= 1.02 * GIVE
    # the rest of the force, F' (t - t_0), drives it: v = F' (t - t_0)^2 / (2 m)
    late = run.t > 0.25
    v = run.v[late, run.solver.layout["block.rigid"].start]
    slope, begin = np.polyfit(run.t[late], np.sqrt(v), 1)
    assert -begin / slope == pytest.approx(end / 1.5, rel=0.01)
    assert slope**2 == pytest.approx(1.5 * limit / end / (2.0 * MASS), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
def test_stick_slip_of_a_block_that_a_spring_pulls(d: int) -> None:
    """The end of a spring k moves with v. The block sticks until k u = mu_0 N and slips until it
    has the velocity v again: extension u and period by the law itself, and where the coefficient
    falls at once from mu_0 to mu, with D = (mu_0 - mu) N / k, by harmonic arcs: it swings by
    sqrt(D^2 + v^2 / w^2), sticks for 2 D / v and slips for (pi + 2 atan(v / (w D))) / w."""
    k, mu0, v, v0, end, step = 10.0, 0.5, 0.1, 2e-3, 1.15, 1e-3
    spring = {"use": "spring_damper", "between": ["block:bottom", "ground"], "stiffness": k,
              "ground": [5.0, *([0.0] * (d - 1))],
              "length": {"use": "ramp", "end": end, "initial": 5.0, "final": 5.0 - v * end}}
    run = march(on_a_plate({**STICK, "static": mu0, "decay_velocity": v0}, end, step, d=d,
                           integrator="bdf2", joints={"spring": spring}))
    t, N = run.t, MASS * G
    u, rest, middle = v * t - travelled(run), mu0 * N / k, MU * N / k
    up = np.flatnonzero((u[:-1] < middle) & (u[1:] >= middle))
    at = t[up] + (middle - u[up]) / (u[up + 1] - u[up]) * step
    swing, period = 0.5 * np.ptp(u[t > 0.45]), np.diff(at)[-1]

    def slips(_: float, y: FloatArray) -> list[float]:
        mu = MU + (mu0 - MU) * np.exp(-y[1] / v0)
        return [v - y[1], (k * y[0] - mu * N) / MASS]

    def ends(_: float, y: FloatArray) -> float:
        return float(y[1])

    ends.terminal, ends.direction = True, -1  # type: ignore[attr-defined]
    slip = solve_ivp(slips, (0.0, 1.0), [rest, 1e-9], events=ends, rtol=1e-9, atol=1e-12,
                     max_step=1e-3)
    assert swing == pytest.approx(0.5 * np.ptp(slip.y[0]), rel=0.01)
    assert period == pytest.approx(slip.t[-1] + (rest - slip.y[0, -1]) / v, rel=0.01)
    D, w = rest - middle, np.sqrt(k / MASS)
    assert swing == pytest.approx(np.hypot(D, v / w), rel=0.04)
    assert period == pytest.approx(
        2.0 * D / v + (pi + 2.0 * np.arctan(v / (w * D))) / w, rel=0.04)


@pytest.mark.full
def test_the_energy_of_a_sliding_block_is_heat_when_it_has_stopped() -> None:
    """Two thermal bodies hold the work of friction on its way, less what the bristles keep, mu m g
    GIVE / 2, and m v^2 / 2 up to an error of the step, v h / 2 of the way; a block that stands
    makes no heat."""
    v, step = 0.1, 5e-4
    scene = on_a_plate(STICK, 0.06, step, velocity=v, fields=("thermal",), integrator="bdf2",
                       heat={"share": 0.3})
    run = march(scene)
    held = np.array([sum(float(b.capacity.sum(axis=0) @ (x - run.x[0])[run.model.layout[b.thermal]])
                         for b in run.model.separated.heat) for x in run.x])
    stop = np.searchsorted(run.t, 1.2 * v / (MU * G))
    way = travelled(run)[-1]
    assert held[-1] == pytest.approx(MU * MASS * G * (way - 0.5 * GIVE), rel=2e-3)
    assert held[-1] == pytest.approx(0.5 * MASS * v * v, rel=0.02)
    assert np.ptp(held[stop:]) < 1e-3 * held[-1]
    assert np.diff(held).min() > -1e-3 * held[-1]
    (block_heat,) = (b for b in run.model.separated.heat if b.thermal == "block.thermal")
    own = block_heat.capacity.sum(axis=0) @ (run.block("block.thermal")[-1] - run.block(
        "block.thermal")[0])
    assert float(own) == pytest.approx(0.3 * held[-1], rel=1e-3)


@pytest.mark.full
def test_halving_the_step_halves_the_error_of_a_stop() -> None:
    """Way of a block that is thrown, v^2 / (2 mu g) and half the elastic displacement."""
    v = 0.1
    far = [travelled(march(on_a_plate(STICK, 0.048, h, velocity=v)))[-1]
           for h in (2e-3, 1e-3, 5e-4)]
    want = v * v / (2.0 * MU * G)
    errors = np.abs(np.array(far) - want)
    assert (errors[:-1] / errors[1:] > 1.7).all()
    assert errors[-1] < 0.02 * want


@pytest.mark.full
def test_a_run_continues_with_the_deflection_of_its_bristles(tmp_path: Path) -> None:
    slope = atan(0.9 * MU)
    scenes = [on_a_plate(STICK, end, 1e-3, slope=slope) for end in (5e-3, 9e-3)]
    for scene, resume in zip(scenes, (False, True), strict=True):
        on = simulate(scene, out=tmp_path / "on", resume=resume)
    whole = simulate(scenes[-1], out=tmp_path / "whole")
    for name in ("block.rigid", "sole.bristles"):
        np.testing.assert_array_equal(on.block(name), whole.block(name))
    assert np.abs(whole.block("sole.bristles")[-1]).max() > 0.5 * GIVE


@pytest.mark.full
@pytest.mark.parametrize("reducer", [
    {"use": "galerkin"}, {"use": "sparse", "sampler": "deim", "budgets": {
        "*.elastic": {"rows": 40}, "*.thermal": {"rows": 30}}}], ids=lambda r: str(r["use"]))
def test_reduced_bodies_stick_as_those_at_full_order(reducer: dict[str, Any]) -> None:
    """Two elastic bodies with temperatures, on the atoms of the run itself."""
    sticks = {"contacts.sole.friction": {"use": "stick", "coefficient": 0.2, "displacement": 1e-6}}
    reference = march(slider(BOTH, steps=20).using(sticks))
    made = {**reducer, "basis": {"use": "pod", "count": 15}}
    run = march(slider(BOTH, steps=20, reducer=made).using(sticks), model=reference.model,
                snapshots=learnt(reference))
    for b in reference.model.layout:
        want = reference.block(b.name)
        error = np.abs(decoded(run, b.name) - want)[1:].max() / np.abs(want).max()
        assert error < 1e-4, b.name
    assert -reference.block("drive.multiplier")[-1, 0] == pytest.approx(0.2 * LOAD, rel=0.01)


def test_along_a_rigid_stage_it_is_refused() -> None:
    scene = on_a_plate(STICK, 2e-3, 1e-3, fields=("thermal",), rigid_stage={})
    with pytest.raises(InputError, match="friction"):
        simulate(scene)
