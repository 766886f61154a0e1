"""Models that the reducer `auto` chooses, next to hand-made reducers of this repository: errors at
parameters that were not trained, CPU time of a step, and time of the choice.

    python tests/benchmarks/errors/advice.py [--quick] [--scenes NAMES] [--sets 20] [--folder DIR]
        [--tolerances 1e-2,1e-3,1e-4]

Parameter sets change two or three numbers by up to 20 % at random: heat flux, start angle and
gravity (pendulums), speed and friction (slider_plate, its speed downwards only: a faster slider
leaves its plate), speed, friction and pressing force (brake_disk), or heat flux, film coefficient
and emissivity (plates); training runs and numbers of atoms stay those of the nominal scene. A
full-order run of each set is stored in DIR once, and so are the errors, so that an interrupted
program continues.

One line per scene, tolerance and model. Errors are relative to the largest change of the block.
`error`: the largest of all fields with the scene's own parameters; `rigid`, `elastic`, `thermal`:
the largest over the sets. `above`: number of sets with a field above the tolerance. `cost`: CPU
time of a step over that of the packaged reducer, and over that of the cheapest hand-made one whose
error is within the tolerance on the same sets (`--hand`: the first of them), in turns. `time`: CPU
time of `advise` with its training run over that of a full-order run.
"""

import argparse
import json
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sparsemor import Scene, advise, load, simulate
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.stages_before_steps import prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, started
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.comparison.error_norms import measure_errors

TOLERANCES = (1e-2, 1e-3, 1e-4)
FIELDS = ("rigid", "elastic", "thermal")
COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
          "time.end": 0.1, "training.end": 0.1}
REPEATS = 3


@dataclass(frozen=True)
class Case:
    """A scene.

    changes: of a parameter set, for random factors (3,) between 0.8 and 1.2; nominal: those of the
    training run; hand_made: changes for the reducers to compare with, next to the packaged one;
    every: steps between stored states; file: the scene, if it is not packaged.
    """

    changes: Callable[[Any], dict[str, Any]]
    nominal: Mapping[str, Any]
    hand_made: Mapping[str, Mapping[str, Any]]
    every: int = 1
    settings: Mapping[str, Any] = field(default_factory=dict)
    file: Path | None = None


def pendulum(f: Any) -> dict[str, Any]:
    return {"loads.heating.flux": float(1e6 * f[0]),
            "bodies.link2.pose.angle": float(0.08726646259971647 * f[1]),
            "loads.gravity.g": [0.0, float(-9.81 * f[2])]}


def slider(f: Any) -> dict[str, Any]:
    speed = float(min(f[0], 2.0 - f[0]))
    return {"joints.drive.x": {"use": "ramp", "end": 1.0, "final": speed},
            "bodies.slider.pose.velocity": [speed, 0.0],
            "contacts.sole.friction.coefficient": float(0.2 * f[1])}


def disk(f: Any) -> dict[str, Any]:
    spin = [0.0, 0.0, float(66.667 * f[0])]
    return {"bodies.disk.pose.spin": spin, "bodies.car.pose.spin": spin,
            "contacts.brake.friction.coefficient": float(0.7 * f[1]),
            "loads.press.force": float(18000 * f[2])}


def flux(values: Sequence[float], times: Sequence[float], f: float) -> dict[str, Any]:
    return {"use": "table", "times": list(times), "values": [float(v * f) for v in values]}


def hot_pendulum(f: Any) -> dict[str, Any]:
    pulses = flux((8e6, 8e6, 0, 0, 1.2e7, 1.2e7, 0), (0, 0.2, 0.25, 0.5, 0.55, 0.9, 1.0), f[0])
    return pendulum(f) | {"loads.heating.flux": pulses}


def hot_plate(f: Any) -> dict[str, Any]:
    return {"loads.lamp.flux": flux((1e5, 5e5, 2e5, 4.5e5, 1e5), (0, 60, 61, 150, 200), f[0]),
            "loads.air.film": float(200 * f[1]), "loads.glow.emissivity": float(0.7 * f[2])}


def radiating_plate(f: Any) -> dict[str, Any]:
    return {"loads.burner.flux": float(1e5 * f[0]), "loads.air.film": float(50 * f[1]),
            "loads.glow.emissivity": min(float(0.9 * f[2]), 1.0)}


def pod(count: int, **bases: int) -> dict[str, Any]:
    """Galerkin projection on POD atoms; bases: numbers by the first word of the pattern."""
    special = {{"thermal": "*.thermal", "slider": "slider.*", "pad": "pad.*"}[n]:
               {"use": "pod", "count": k} for n, k in bases.items()}
    return {"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": count},
                        "bases": special}}


def ecsw(count: int) -> dict[str, Any]:
    return {"reducer": {"use": "ecsw", "basis": {"use": "pod", "count": count}}}


def pulses(heat: int, less: int) -> dict[str, Any]:
    """Training-free atoms of the slider (tests/benchmarks/studies/outside_slider.yaml)."""
    def both(k: int) -> tuple[dict[str, Any], dict[str, Any]]:
        own = {"use": "impulse", "count": k}
        return own, {"use": "dictionary", "orthonormal": True, "bases": [
            {"use": "attachment", "thermal": own, "count": k}, "static"]}
    return {"reducer": {"use": "galerkin", "basis": both(heat)[0], "bases": {
        "slider.thermal": both(less)[0], "plate.elastic": both(heat)[1],
        "slider.elastic": both(less)[1]}}}


CASES = {
    "slider_plate": Case(slider, slider((1.0, 1.0, 1.0)), {
        "POD 100": pod(100, slider=20),  # studies/slider_methods.yaml
        "pulses": pulses(300, 120),
        "POD 200, 5 training runs": {  # docs/kept-models.md
            **pod(200, slider=100), "parameters": {
                "speed": {"key": ["joints.drive.x.final", "bodies.slider.pose.velocity.0"],
                          "range": [0.8, 1.0]},
                "friction": {"key": "contacts.sole.friction.coefficient", "range": [0.15, 0.25]}},
            "training.every": 2, "training.parameters": {"choice": "corners"}}}),
    "double_pendulum": Case(pendulum, pendulum((1.0, 1.0, 1.0)), {
        "POD 40/30": pod(40, thermal=30), "POD 80/20": pod(80, thermal=20)}, 4),
    "brake_disk": Case(disk, disk((1.0, 1.0, 1.0)), {
        "POD 100": pod(100, pad=20), "POD 200": pod(200, pad=30)}, 4),
    "hot_pendulum": Case(
        hot_pendulum, pendulum((1.0, 1.0, 1.0)) | load("hot_pendulum").training.overrides,
        {"ECSW 30": ecsw(30)}),
    "hot_plate": Case(
        hot_plate, hot_plate((1.0, 1.0, 1.0)) | load("hot_plate").training.overrides,
        {"ECSW 8": ecsw(8), "ECSW 30": ecsw(30)}),
    "radiating_plate": Case(
        radiating_plate, radiating_plate((1.0, 1.0, 1.0)), {"ECSW 8": ecsw(8), "POD 8": pod(8)},
        file=Path(__file__).parents[3] / "docs/examples/radiating_plate.yaml"),
}
QUICK = {"double_pendulum": Case(
    pendulum, pendulum((1.0, 1.0, 1.0)), {"POD 40/30": pod(40, thermal=30)}, settings=COARSE)}


def cpu(do: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.process_time()
    found = do()
    return found, time.process_time() - begun


class Bench:
    """Runs of one scene, whose full-order results and errors are stored in a folder."""

    def __init__(self, name: str, case: Case, folder: Path) -> None:
        self.name, self.case = name, case
        self.folder = folder / name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.cache, self.bodies = Cache(folder / "cache"), BodyCache()
        self.scene = load(case.file or name, dict(case.settings))
        self.known = self.folder / "known.json"
        self.numbers: dict[str, Any] = (
            json.loads(self.known.read_text()) if self.known.exists() else {})
        factors = np.random.default_rng(1).uniform(0.8, 1.2, (100, 3))
        self.changes = [dict[str, Any](), *map(case.changes, factors)]

    def remembered(self, key: str, make: Callable[[], Any]) -> Any:
        if key not in self.numbers:
            self.numbers[key] = make()
            self.known.write_text(json.dumps(self.numbers))
        return self.numbers[key]

    def reference(self, i: int) -> RunResult:
        """Full-order run of set i, 0 for the nominal scene."""
        out = self.folder / f"full_{i:02d}"
        if not out.with_suffix(".done").exists():
            shutil.rmtree(out, ignore_errors=True)
            simulate(self.scene.using({
                **self.changes[i], "reducer": "full", "output.every": self.case.every}),
                out=out, cache=self.cache, body_cache=self.bodies)
            out.with_suffix(".done").touch()
        return RunResult(out / "result")

    def error(self, model: Scene, i: int) -> dict[str, float]:
        """Largest error of each field in a run of set i; inf for a run that stops."""
        change = self.changes[i]
        boxed = model.training.parameters is not None
        trained = {"training.overrides": self.case.nominal} if (
            change and self.case.nominal and not boxed) else {}
        scene = model.using({**change, **trained, "output.every": self.case.every})

        def made() -> dict[str, float]:
            full = self.reference(i)
            try:
                found = measure_errors(full, simulate(
                    scene, cache=self.cache, body_cache=self.bodies)).worst
            except SolveFailed:
                found = dict.fromkeys((b.field for b in full.layout), float("inf"))
            return {name: found[name] for name in FIELDS if name in found}

        return dict(self.remembered(f"error {scene.digest()}", made))

    def errors(self, model: Scene, sets: int, limit: float = np.inf) -> list[float]:
        """Errors at the first sets, up to the first one above `limit`."""
        found = list[float]()
        for i in range(1, sets + 1):
            found.append(max(self.error(model, i).values()))
            if found[-1] > limit:
                break
        return found

    @np.errstate(all="ignore")
    def steps(self, scene: Scene) -> Callable[[], float]:
        """CPU time, s, of all steps of a scene, prepared; without the projection of its start."""
        run, _ = prepared_run(scene, self.cache, new_manager(()), self.bodies)
        step = step_of(run.solver, scene.integrator, scene.time.step)

        def march() -> float:
            state, memory = started(run.solver, scene.integrator, run.start)
            begun = time.process_time()
            for _ in iterate(step, state, memory, step_count(scene)):
                pass
            return time.process_time() - begun

        return march

    def full_seconds(self) -> float:
        """CPU time, s, of a full-order run in an empty cache."""
        with TemporaryDirectory() as place:
            return cpu(lambda: simulate(
                self.scene.using({"reducer": "full"}), cache=Cache(place)))[1]

    def advice_seconds(self, tolerance: float) -> float:
        """CPU time, s, of `advise` with its training run."""
        with TemporaryDirectory() as place:
            return cpu(lambda: advise(self.scene, tolerance=tolerance, cache=Cache(place)))[1]


def measured(
    bench: Bench, tolerances: Sequence[float], sets: int, hand: int, timed: bool
) -> None:
    case, name, scene = bench.case, bench.name, bench.scene
    chosen = {t: advise(scene, tolerance=t, cache=bench.cache, body_cache=bench.bodies)
              for t in tolerances}
    errors: dict[float, list[dict[str, float]]] = {t: [] for t in tolerances}
    for i in range(sets + 1):
        for t, advice in chosen.items():
            errors[t].append(bench.error(advice.scene, i))
            print(f"{name} {t:g}, set {i}: {errors[t][-1]}", file=sys.stderr, flush=True)
    hand_made = {"packaged": scene, **{
        label: scene.using(dict(settings)) for label, settings in case.hand_made.items()}}
    found = {label: bench.errors(model, min(hand, sets), max(tolerances))
             for label, model in hand_made.items() if hand}
    for label, e in found.items():
        print(f"| {name} | | {label} | | largest {max(e):.1e} | | | of {len(e)} | | |", flush=True)
    marches = {label: bench.steps(model) for label, model in hand_made.items()
               if label == "packaged" or hand and max(found[label]) <= max(tolerances)}
    whole = bench.full_seconds() if timed else np.nan
    for t, advice in chosen.items():
        other, met = errors[t][1:], [label for label, e in found.items() if max(e) <= t]
        march, spent = bench.steps(advice.scene), dict[str, list[float]]()
        for _ in range(REPEATS):
            for label in dict.fromkeys(["packaged", *met]):
                spent.setdefault(label, []).append(march() / marches[label]())
        ratio = {label: float(np.median(r)) for label, r in spent.items()}
        best = max(met, key=lambda label: ratio[label], default="")
        took = f"{bench.advice_seconds(t) / whole:.1f}" if timed else ""
        each = " | ".join(
            f"{max(e[n] for e in other):.1e}" if other and n in other[0] else "" for n in FIELDS)
        atoms = "/".join(map(str, advice.choice.trials[-1].atoms.values()))
        print(f"| {name} | {t:g} | {advice.choice.reducer['use']} {atoms} | "
              f"{max(errors[t][0].values()):.1e} | {each} | "
              f"{sum(max(e.values()) > t for e in other)} of {len(other)} | "
              f"{ratio['packaged']:.2f}, "
              + (f"{ratio[best]:.2f} ({best})" if met else "none meets it" if hand else "not tried")
              + f" | {took} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--scenes", default=",".join(CASES))
    parser.add_argument("--sets", type=int, default=20, help="0: the scene's own parameters alone")
    parser.add_argument("--tolerances", default=",".join(f"{t:g}" for t in TOLERANCES))
    parser.add_argument("--hand", type=int, default=5, help="sets for hand-made reducers, or 0")
    parser.add_argument("--folder", type=Path, default=Path("advice"))
    parser.add_argument("--no-time", action="store_true", help="do not measure `time`")
    given = parser.parse_args()
    tolerances = [float(t) for t in given.tolerances.split(",")]
    cases = QUICK if given.quick else {n: CASES[n] for n in given.scenes.split(",")}
    print("| scene | tolerance | model | error | rigid | elastic | thermal | above | cost | time |"
          "\n|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for name, case in cases.items():
        with TemporaryDirectory() as place:
            measured(Bench(name, case, Path(place) if given.quick else given.folder), tolerances,
                     1 if given.quick else given.sets, given.hand, not given.no_time)


if __name__ == "__main__":
    main()
