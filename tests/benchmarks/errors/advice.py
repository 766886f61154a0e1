"""Models that the reducer `auto` chooses: errors in training and under loads that were not trained,
CPU time of a step relative to the packaged reducer, and time of the choice.

    python tests/benchmarks/errors/advice.py [--quick] [--scenes NAMES] [--sets 20]

One line per scene and tolerance. `error`: the largest of all fields (rigid, elastic, thermal),
relative to the largest change of the block, in training, and the largest over all parameter sets,
which change speed, friction, heat flux and start angle by up to 20 % at random (the slider's speed
downwards only: a faster one leaves its plate). The bases stay those of the nominal training run.
`above`: number of parameter sets with a field above the tolerance. `cost`: CPU time per step over
that of the packaged reducer, in turns. `time`: CPU time of `advise` with its training run over that
of the training run alone.
"""

import argparse
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sparsemor import Scene, advise, load, simulate
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.error_norms import measure_errors
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepare import prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, started
from sparsemor.core.status import SolveFailed

TOLERANCES = (1e-2, 1e-3, 1e-4)
FIELDS = ("rigid", "elastic", "thermal")
COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
          "time.end": 0.1, "training.end": 0.1}
REPEATS = 3


@dataclass(frozen=True)
class Case:
    """Scene, changes for random factors (2,) between 0.8 and 1.2, and those of the training run."""

    settings: Mapping[str, Any]
    changes: Callable[[Any], dict[str, Any]]
    nominal: Mapping[str, Any]


def pendulum(f: Any) -> dict[str, Any]:
    return {"loads.heating.flux": float(1e6 * f[0]),
            "bodies.link2.pose.angle": float(0.08726646259971647 * f[1])}


def slider(f: Any) -> dict[str, Any]:
    speed = float(min(f[0], 2.0 - f[0]))
    return {"joints.drive.x": {"use": "ramp", "end": 1.0, "final": speed},
            "bodies.slider.pose.velocity": [speed, 0.0],
            "contacts.sole.friction.coefficient": float(0.2 * f[1])}


def disk(f: Any) -> dict[str, Any]:
    spin = [0.0, 0.0, float(66.667 * f[0])]
    return {"bodies.disk.pose.spin": spin, "bodies.car.pose.spin": spin,
            "contacts.brake.friction.coefficient": float(0.7 * f[1])}


CASES = {
    "double_pendulum": Case({}, pendulum, pendulum((1.0, 1.0))),
    "slider_plate": Case({}, slider, {}),
    "brake_disk": Case({}, disk, {}),
}
QUICK = {"double_pendulum": Case(COARSE, pendulum, pendulum((1.0, 1.0)))}


def cpu(do: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.process_time()
    found = do()
    return found, time.process_time() - begun


@np.errstate(all="ignore")
def steps(scene: Scene, cache: Cache, bodies: BodyCache) -> Callable[[], None]:
    """All steps of a scene, prepared."""
    run, _ = prepared_run(scene, cache, new_manager(()), bodies)
    step = step_of(run.solver, scene.integrator, scene.time.step)

    def march() -> None:
        for _ in iterate(step, *started(run.solver, scene.integrator, run.start),
                         step_count(scene)):
            pass

    return march


def worst(reference: RunResult, scene: Scene, cache: Cache, bodies: BodyCache) -> float:
    """Largest error of a field; inf for a run that stops."""
    try:
        found = measure_errors(
            reference, simulate(scene, cache=cache, body_cache=bodies)).worst
    except SolveFailed:
        return float("inf")
    return max(e for name, e in found.items() if name in FIELDS)


def measured(name: str, case: Case, sets: int, tolerances: Iterable[float]) -> None:
    with TemporaryDirectory() as place:
        cache, bodies, rng = Cache(place), BodyCache(), np.random.default_rng(1)
        scene = load(name, dict(case.settings))
        advised = {}
        seconds = 0.0
        for tolerance in tolerances:
            advised[tolerance] = cpu(lambda t=tolerance: advise(
                scene, tolerance=t, cache=cache, body_cache=bodies))
            if not seconds:
                seconds = cpu(lambda: simulate(
                    scene.using({"reducer": "full"}), cache=Cache(f"{place}/new")))[1]
                first = advised[tolerance][1]
        changes = [dict[str, Any](), *(
            case.changes(rng.uniform(0.8, 1.2, 2)) for _ in range(sets))]
        errors: dict[float, list[float]] = {t: [] for t in tolerances}
        for change in changes:
            full = simulate(scene.using({**change, "reducer": "full"}), cache=cache,
                            body_cache=bodies)
            trained = {"training.overrides": case.nominal} if change and case.nominal else {}
            for t, (advice, _) in advised.items():
                errors[t].append(worst(
                    full, advice.scene.using({**change, **trained}), cache, bodies))
        packaged = steps(scene, cache, bodies)
        for t, (advice, cost) in advised.items():
            chosen, ratios = steps(advice.scene, cache, bodies), []
            for _ in range(REPEATS):
                ratios.append(cpu(chosen)[1] / cpu(packaged)[1])
            atoms = "/".join(map(str, advice.choice.trials[-1].atoms.values()))
            other = errors[t][1:]
            spent = first if t == next(iter(tolerances)) else cost + seconds
            print(f"| {name} | {t:g} | {advice.choice.reducer['use']} {atoms} | "
                  f"{errors[t][0]:.1e} | {max(other, default=0.0):.1e} | "
                  f"{sum(e > t for e in other)} of {len(other)} | "
                  f"{float(np.median(ratios)):.2f} | {spent / seconds:.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--scenes", default=",".join(CASES))
    parser.add_argument("--sets", type=int, default=20)
    given = parser.parse_args()
    cases = QUICK if given.quick else {n: CASES[n] for n in given.scenes.split(",")}
    print("| scene | tolerance | chosen | error | error, other loads | above | cost | time |\n"
          "|---|---|---|---|---|---|---|---|", flush=True)
    for name, case in cases.items():
        measured(name, case, 1 if given.quick else given.sets,
                 TOLERANCES[1:2] if given.quick else TOLERANCES)


if __name__ == "__main__":
    main()
