"""Estimates of errors at the few steps that `error_estimate: on` permits, against true errors, of
random scenes whose loads differ between training and run, and what they cost.

    python tests/benchmarks/errors/random_estimates.py FIRST LAST [--reducers galerkin,sparse]
    python tests/benchmarks/errors/random_estimates.py FIRST LAST --from FILE
    python tests/benchmarks/errors/random_estimates.py --scenes double_pendulum --trained same,half
    python tests/benchmarks/errors/random_estimates.py --scenes double_pendulum --trained 1,2,3,4

One line per run and block with an error above 1e-6: the largest error relative to the block's
largest change, and the quotient estimate / error of the largest values over the run, and of 5, 50
and 95 % of its single estimates; per run the CPU time of the estimates as a share of that of the
steps. Then the shares of quotients between 0.5 and 10, of all blocks of a field and all estimates
of which the error is above 1e-6: at the time of the estimate, of the largest values up to then, and
at all stored times from the first estimate on, between which the last one counts.

--from: a file with a function `scene(seed)` that returns a kind, a remark and a scene as plain
data. --trained: packaged scenes trained on the run itself, to half its time, or run with loads that
vary in time by a random function of this seed. `few`, `few_sparse`: `galerkin` and `sparse` with
four atoms of each block.
"""

import argparse
import random
import runpy
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.error_record import ErrorRecord
from sparsemor.core.simulation.run_steps import RunSteps
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.comparison.error_norms import measure_errors

LEAST, LOW, HIGH = 1e-6, 0.5, 10.0
FOUR = {"use": "pod", "count": 4}
REDUCERS: Mapping[str, Any] = {
    "galerkin": "galerkin", "sparse": "sparse", "ecsw": "ecsw",
    "few": {"use": "galerkin", "basis": FOUR}, "few_sparse": {"use": "sparse", "basis": FOUR}}
KINDS = ("cantilever", "heated", "steel", "plate", "block", "pendulum", "double")
INTEGRATORS: tuple[Any, ...] = ("bdf1", "bdf2", {"use": "generalized_alpha", "rho_inf": 0.8})
ALUMINIUM = {"E": 7e10, "nu": 0.3, "rho": 2700.0, "alpha": 2.3e-5, "k": 150.0, "c": 900.0}
K_OF_T = {"rho": 7850.0, "k": {"temperatures": [293.15, 1073.15], "values": [53.3, 27.3]},
          "c": {"temperatures": [293.15, 1073.15], "values": [440.0, 900.0]}}
POLYMER = {"E": 2e9, "nu": 0.3, "rho": 1500.0, "alpha": 8e-5, "k": 10.0, "c": 1000.0}
FILM = {"use": "convection", "on": ["b:bottom"], "film": 300.0, "temperature": 293.15}
GLOW = {"use": "radiation", "on": ["b:top"], "emissivity": 0.8, "surroundings": 293.15}
BOTH = ["elastic", "thermal"]
COARSE = {f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)}
SHORT: Mapping[str, Mapping[str, Any]] = {
    "double_pendulum": {**COARSE, "time.end": 0.4, "training.end": 0.4},
    "hot_pendulum": {**COARSE, "time.end": 0.2, "training.end": 0.2}}
"""Scene -> settings of a shorter run on a coarser mesh."""
LOADS = ("flux", "pressure", "factor")
"""Options of loads that are functions of time."""
FIELDS = ("elastic", "thermal", "rigid")
Quotients = dict[str, list[float]]
"""Meaning, then field -> quotients."""
spent = {"steps": 0.0, "estimates": 0.0}


def function(rng: random.Random, end: float, amplitude: float) -> dict[str, Any]:
    """A function of time of random kind."""
    start, length = rng.uniform(0.0, 0.4) * end, rng.uniform(0.2, 0.5) * end
    return rng.choice([
        {"use": "sine", "amplitude": amplitude, "frequency": rng.uniform(0.5, 4.0) / end,
         "phase": rng.uniform(0.0, 3.0)},
        {"use": "ramp", "start": start, "end": start + length, "final": amplitude},
        {"use": "pulse", "start": start, "duration": length, "level": amplitude},
        {"use": "smooth_step", "start": start, "end": start + length, "final": amplitude},
        {"use": "constant", "level": amplitude}])


def body(kind: str) -> dict[str, Any]:
    """A fixed body, or the link of a pendulum."""
    if kind == "plate":
        return {"mesh": {"use": "unstructured", "size": [0.1, 0.05], "divisions": [20, 10],
                         "elements": 600}, "thickness": 0.01, "material": K_OF_T,
                "fields": ["thermal"], "frame": "fixed",
                "sets": {"one": {"box": [[0.01, 0.04], [0.0499, 0.051]]},
                         "two": {"box": [[0.06, 0.09], [0.0499, 0.051]]}}}
    if kind == "block":
        return {"mesh": {"use": "block", "size": [0.2, 0.04, 0.04], "divisions": [10, 3, 3]},
                "material": ALUMINIUM, "fields": BOTH, "frame": "fixed",
                "reference": {"clamp": "left"}, "damping": {"stiffness": 1e-5},
                "sets": {"one": {"where": "z > 0.0399 and x > 0.1"},
                         "two": {"where": "z < 0.0001 and x < 0.1"}}}
    if kind in ("pendulum", "double"):
        return {"mesh": {"use": "rectangle", "lower": [0.0, -0.02], "size": [0.5, 0.04],
                         "divisions": [24, 4]}, "thickness": 0.02, "material": POLYMER,
                "fields": BOTH, "reference": {"chord": ["a", "e"]},
                "damping": {"stiffness": 2e-4},
                "sets": {"a": {"nearest": [0.0, 0.0]}, "e": {"nearest": [0.5, 0.0]}}}
    return {"mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [1.0, 0.1],
                     "divisions": [32, 4], "diagonal": "alternating"}, "thickness": 0.02,
            "material": {"use": "carbon_steel"} if kind == "steel" else ALUMINIUM,
            "fields": ["elastic"] if kind == "cantilever" else BOTH,
            "reference": {"clamp": "left"}, "frame": "fixed", "damping": {"stiffness": 1e-5},
            "sets": {"one": {"box": [[0.2, 0.5], [0.049, 0.051]]},
                     "two": {"box": [[0.4, 0.8], [-0.051, -0.049]]}}}


def random_scene(seed: int) -> tuple[str, Scene]:
    """A scene whose training has other functions of its loads, or lacks one, and its kind."""
    rng, kind = random.Random(seed), KINDS[seed % len(KINDS)]
    end, steps = {"cantilever": (0.05, 100), "plate": (30.0, 100), "block": (10.0, 80),
                  "pendulum": (0.4, 200), "double": (0.4, 200)}.get(kind, (20.0, 100))
    own = body(kind)
    names = ["b", "c"] if kind == "double" else ["b"]
    bodies = {n: {"use": "flexible", **own} for n in names}
    joints: dict[str, Any] = {}
    loads: dict[str, Any] = {}
    other: dict[str, Any] = {}
    if kind in ("pendulum", "double"):
        joints["O"] = {"use": "revolute", "between": ["ground", "b:a"]}
        loads["weight"] = {"use": "gravity"}
    if kind == "double":
        bodies["c"]["pose"] = {"position": [0.5, 0.0]}
        joints["A"] = {"use": "revolute", "between": ["b:e", "c:a"]}

    def add(name: str, tree: dict[str, Any], key: str, amplitude: float) -> None:
        mine = function(rng, end, amplitude * rng.choice([1.0, -1.0, 2.0, 0.5]))
        loads[name] = {**tree, key: mine}
        other[f"loads.{name}.{key}"] = rng.choice([
            function(rng, end, amplitude), {"use": "constant", "level": 0.0}, mine,
            {"use": "product", "factors": [0.3, mine]}])

    for n in names:
        links = kind in ("pendulum", "double")
        edges = ["top", "bottom"] if links else ["one", "two"]
        if "thermal" in own["fields"]:
            for i, edge in enumerate(edges):
                flux = {"use": "heat_flux", "on": [f"{n}:{edge}"]}
                add(f"heat_{n}{i}", flux, "flux", 3e4 if links else 2e5)
        if "elastic" in own["fields"]:
            size = 2e3 if links else 1e5
            force = [rng.uniform(-size, size) for _ in range(3 if kind == "block" else 2)]
            add(f"pull_{n}", {"use": "traction", "on": [f"{n}:{rng.choice(edges)}"],
                              "traction": force}, "factor", 1.0)
    if "thermal" in own["fields"] and not joints:
        loads["film"] = FILM
    if kind in ("steel", "plate"):
        loads["glow"] = GLOW
    return kind, scene_of({
        "bodies": bodies, "joints": joints, "loads": loads, "integrator": rng.choice(INTEGRATORS),
        "time": {"end": end, "step": end / steps}, "training": {"overrides": other}})


def timed(kind: type, name: str, key: str) -> None:
    """Adds the CPU time of calls of a method to `spent`."""
    method = getattr(kind, name)

    def call(self: Any, *arguments: Any) -> Any:
        begun = time.process_time()
        found = method(self, *arguments)
        spent[key] += time.process_time() - begun
        return found
    setattr(kind, name, call)


def varied(scene: Scene, seed: int) -> Scene:
    """A scene whose loads are multiplied by random functions of time in the run, not in training.
    """
    rng, changes, own = random.Random(seed), {}, {}
    for name, load_tree in scene.dump()["loads"].items():
        for key in LOADS:
            if (mine := load_tree.get(key)) is not None:
                own[f"loads.{name}.{key}"] = mine
                changes[f"loads.{name}.{key}"] = {"use": "product", "factors": [mine, {
                    "use": "sine", "amplitude": rng.uniform(0.2, 0.8), "offset": 1.0,
                    "frequency": rng.uniform(0.5, 4.0) / scene.time.end,
                    "phase": rng.uniform(0.0, 3.0)}]}
    return scene.using({**changes, "training.overrides": own})


def trained_as(scene: Scene, way: str) -> Scene:
    """A scene that is trained on its own run (`same`), to half its time (`half`), or whose loads
    are not those of the training (a seed)."""
    if way == "same":
        return scene.using({"training.overrides": {}})
    return scene.using({"training.end": scene.time.end / 2}) if way == "half" else varied(
        scene, int(way))


def packaged(names: str, trained: str) -> Iterator[tuple[str, Scene]]:
    """Packaged scenes by the ways of their training."""
    for name in names.split(","):
        scene = load(name, dict(SHORT.get(name, {})))
        for way in trained.split(","):
            yield f"{name} {way}", trained_as(scene, way)


def judged(name: str, scene: Scene, full: Any, found: dict[str, Quotients]) -> list[float]:
    """Quotients of the largest values of the blocks of a run, printed; adds those of each estimate
    to `found`."""
    spent.update(steps=0.0, estimates=0.0)
    try:
        run = simulate(scene.using({"reducer.error_estimate": "on", "check_stability": "off"}))
    except (InputError, SolveFailed) as error:
        print(f"| {name} | {str(error)[:60]} |", flush=True)
        return []
    e, largest = measure_errors(full, run), []
    share = spent["estimates"] / max(spent["steps"] - spent["estimates"], 1e-9)
    compared = [b for b in e.estimated if b in e.blocks]
    guesses = np.array([e.estimated[b] for b in compared])
    at = np.flatnonzero((np.diff(guesses, axis=1) != 0.0).any(axis=0)) + 1  # of the estimates
    for block, guess in zip(compared, guesses, strict=True):
        true, field = e.series[block], block.split(".")[-1]
        meanings = {
            "at the time": (true[at], guess[at]),
            "largest until then": (
                np.maximum.accumulate(true)[at], np.maximum.accumulate(guess)[at]),
            "all stored times": (true[at[0] :], guess[at[0] :])}
        single = meanings["at the time"]
        for meaning, (size, value) in meanings.items():
            found.setdefault(meaning, {}).setdefault(field, []).extend(
                (value[size > LEAST] / size[size > LEAST]).tolist())
        if true.max() > LEAST:
            largest.append(float(guess.max() / true.max()))
            some = (single[1] / np.maximum(single[0], 1e-300))[single[0] > LEAST]
            spread = " to ".join(f"{q:.2g}" for q in np.quantile(some, (0.05, 0.5, 0.95))) if (
                len(some)) else ""
            print(f"| {name} | {block} | {true.max():.1e} | {largest[-1]:.2f} | {spread} | "
                  f"{share:.1%} |", flush=True)
    return largest


def inside(values: list[float]) -> str:
    """Share of quotients between the limits, and their number."""
    good = [LOW <= q <= HIGH for q in values]
    return f"{np.mean(good):.1%} of {len(values)}" if values else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("last", type=int, nargs="?", default=21)
    parser.add_argument("--reducers", default="galerkin,sparse,few,few_sparse")
    parser.add_argument("--from", dest="file", help="file with random scenes")
    parser.add_argument("--scenes", help="packaged scenes")
    parser.add_argument("--trained", default="half", help="same, half, or seeds")
    given = parser.parse_args()
    timed(RunSteps, "portion", "steps")
    timed(ErrorRecord, "_evaluate", "estimates")
    named: Iterator[tuple[str, Scene]]
    if given.scenes:
        named = packaged(given.scenes, given.trained)
    elif given.file:
        drawn = runpy.run_path(given.file)["scene"]
        made = ((seed, drawn(seed)) for seed in range(given.first, given.last))
        named = ((f"{seed} {one[0]}", scene_of(one[-1])) for seed, one in made)
    else:
        numbered = ((n, random_scene(n)) for n in range(given.first, given.last))
        named = ((f"{seed} {kind}", scene) for seed, (kind, scene) in numbered)
    print("| run | block | error | largest | single | share |\n|---|---|---|---|---|---|")
    quotients: dict[str, list[float]] = {}
    found: dict[str, Quotients] = {}
    with np.errstate(all="ignore"):
        for name, scene in named:
            full = simulate(scene.using({"reducer": "full"}), keep_training=True)
            for reducer in given.reducers.split(","):
                own = scene.using({"reducer": REDUCERS[reducer]})
                quotients.setdefault(reducer, []).extend(
                    judged(f"{name} {reducer}", own, full, found))
    for reducer, values in quotients.items():
        print(f"{reducer}: largest values {inside(values)} between {LOW:g} and {HIGH:g}, from "
              f"{min(values):.2g} to {max(values):.2g}")
    print(f"\n| between {LOW:g} and {HIGH:g} | {' | '.join(FIELDS)} | all |\n|---|---|---|---|---|")
    for meaning, by in found.items():
        values = [v for f in FIELDS for v in by.get(f, [])]
        print(f"| {meaning} | {' | '.join(inside(by.get(f, [])) for f in FIELDS)} | "
              f"{inside(values)} |")


if __name__ == "__main__":
    main()
