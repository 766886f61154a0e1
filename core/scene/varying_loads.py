"""Loads that may vary: the functions of time that training runs have in their place, so that a
reduced model is built for all of them and not for one run."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from sparsemor.core.protocols.connector import LoadPlugin
from sparsemor.core.protocols.time_function import HeldFunction, TimeFunction
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.scene.default_plugins import TABLE
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.core.scene.overrides import inside, split

Range = Annotated[list[float], Field(min_length=2, max_length=2)]
"""Smallest and largest value."""
VaryingLoads = (Literal["varying"] | Annotated[list[str], Field(min_length=1)]
                | Annotated[dict[str, Range], Field(min_length=1)])
"""All loads, or those of these names, with a range or without."""
LoadFault = tuple[tuple[str | int, ...], str]
"""Location below `training`, and message."""
TOGETHER = 3
"""Number of training runs in which all loads vary at once."""
SAMPLES = 1000
"""Number of times at which the largest value of a function is looked for."""
JUMP = 1e-9
"""Duration of a jump, as a share of the run."""
ALONE = ((0.0, 1, 1), (0.05, 1, 0), (0.2, 0, 1), (0.55, 1, -1), (0.6, -1, 0), (0.7, 0, 0),
         (0.9, 1, 0), (0.95, 0, -1), (1.0, -1, -1))
"""Signal of a load that varies alone: time, as a share of the run, and value before and after it;
1 and -1 are the far and near end of its range, 0 is its base. An impulse, a step, its reversal for
a short time, a ramp, and a reversal to the end."""


@dataclass(frozen=True, slots=True)
class Varying:
    """Function of time of a load that may vary.

    key: dotted key in the scene; base: its value while other loads vary alone; far, near: ends of
    its range, far the one farther from the base; level: True for a level, such as an ambient
    temperature, which keeps its function of time while other loads vary alone.
    """

    key: str
    base: float
    far: float
    near: float
    level: bool

    def alone(self, end: float) -> dict[str, Any]:
        """Signal up to `end`, s, while the other loads have their base."""
        of = {1: self.far, 0: self.base, -1: self.near}
        # ALONE: share of the time, and which end or base the value is before and after it
        return table(end, [(t, of[v]) for t, a, b in ALONE for v in (a, b)])

    def together(self, end: float, rng: np.random.Generator) -> dict[str, Any]:
        """Random signal up to `end`, s: steps, ramps and pauses of 0.02 to 0.5 of it."""
        t, value, points = 0.0, self._random(rng), list[tuple[float, float]]()
        while t < 1.0:
            later = min(1.0, t + 0.02 * 25.0 ** rng.random())
            kind, goal = rng.integers(3), self._random(rng)
            # from here to `later`: a ramp to the goal, a step to it, or a pause at the base
            start, value = {0: (value, goal), 1: (goal, goal), 2: (self.base, self.base)}[int(kind)]
            points += [(t, start), (later, value)]
            t = later
        return table(end, points)

    def _random(self, rng: np.random.Generator) -> float:
        """One of both ends, the far one twice as often, or a value between them."""
        between = self.near + (self.far - self.near) * float(rng.random())
        return (self.far, self.far, self.near, between)[int(rng.integers(4))]


def table(end: float, points: list[tuple[float, float]]) -> dict[str, Any]:
    """Piecewise linear function of time, as in a scene, from times, as shares of `end`, and values;
    two values at one time are a jump."""
    times, values = list[float](), list[float]()
    for t, value in points:
        if times and t * end <= times[-1]:
            if value == values[-1]:
                continue
            t = times[-1] / end + JUMP
        times.append(t * end)
        values.append(value)
    return {"use": TABLE, "times": times, "values": values}


@dataclass(frozen=True, slots=True)
class LoadTraining:
    """Training over the loads that may vary.

    loads: of the scene; varying: those that may vary; end: of the run, s; fixed: keys of the
    scene's parameters, which vary as these.
    """

    loads: Mapping[str, LoadPlugin]
    varying: VaryingLoads
    end: float
    fixed: Sequence[str] = ()

    def cases(self, until: float) -> list[dict[str, Any]]:
        """Changes of the scene for each training run, up to `until`, s: one for each load that
        varies alone, and `TOGETHER` in which all vary."""
        found = [v for v in self._each() if isinstance(v, Varying) and v.far != v.near]
        rest = {v.key: v.base for v in found if not v.level}
        cases = [{**rest, v.key: v.alone(until)} for v in found]
        for i in range(TOGETHER):
            cases.append({v.key: v.together(until, np.random.default_rng((i, j)))
                          for j, v in enumerate(found)})
        return cases if found else []

    def faults(self, overrides: Mapping[str, Any]) -> Iterator[LoadFault]:
        """Loads that do not exist or have no function of time, and overrides of their
        functions."""
        found = list(self._each())
        for v in found:
            if not isinstance(v, Varying):
                yield v
                continue
            for key in overrides:
                if inside(key, v.key):
                    yield ("overrides", key), f"{v.key} varies in training (training.loads), so " \
                        "that this has no effect: remove it"
        if not found:
            yield ("loads",), "no load of the scene has a function of time that could vary"

    def unvaried(self) -> dict[str, float]:
        """Functions of time that would vary but for their range, with their value: amplitudes that
        are 0 in this scene, and constant levels, if they are named or nothing else varies.
        Controllers vary by themselves."""
        functions = self._functions()
        found = [v for v in self._each() if isinstance(v, Varying)]
        still = {v.key: v.base for v in found if v.far == v.near
                 and not isinstance(functions[v.key], HeldFunction)}
        amplitudes = {v.key for v in found if not v.level}
        return still if len(still) == len(found) or not isinstance(self.varying, str) else {
            key: value for key, value in still.items() if key in amplitudes}

    def _each(self) -> Iterator[Varying | LoadFault]:
        """Each function of time that may vary, or its fault."""
        functions = self._functions()
        if isinstance(self.varying, str):
            for key in functions:
                if not self._is_parameter(key):
                    yield self._ranged(key, functions[key], None)
            return
        for i, name in enumerate(self.varying):
            ranged = isinstance(self.varying, Mapping)
            at: tuple[str | int, ...] = ("loads", name if ranged else i)
            given = self.varying[name] if isinstance(self.varying, Mapping) else None
            keys = [k for k in functions if inside(k, f"loads.{name}")]
            if split(name)[0] not in self.loads:
                yield at, (f"the scene has no load {name!r}: "
                           f"{suggestions(name, list(self.loads), 'loads')}")
            elif not keys:
                yield at, f"load {name} has no function of time that could vary"
            elif any(map(self._is_parameter, keys)):
                yield at, f"load {name} varies as a parameter of the scene"
            elif given is not None and not given[0] < given[1]:
                yield at, f"the first value must be the smaller one (got {given})"
            elif given is not None and len(keys) > 1:
                named = ", ".join(".".join(map(str, split(k)[1:])) for k in keys)
                yield at, f"load {name} has several functions of time: give the range of {named}"
            else:
                for key in keys:
                    yield self._ranged(key, functions[key], given)

    def _functions(self) -> dict[str, TimeFunction]:
        """Key -> function of time of the loads, without those inside of others."""
        found: dict[str, TimeFunction] = {}
        for key, f in functions_of_time({"loads": self.loads}):
            if not any(inside(key, other) for other in found):
                found[key] = f
        return found

    def _is_parameter(self, key: str) -> bool:
        return any(inside(other, key) for other in self.fixed)

    def _ranged(self, key: str, f: TimeFunction, given: list[float] | None) -> Varying:
        """A function of time with its range: that which is given, else the values of a level over
        the run, or minus and plus the largest value of an amplitude. levels: options of the load
        that are levels, such as an ambient temperature."""
        _, name, option, *_ = map(str, split(key))
        level = option in self.loads[name].levels
        times = (*np.linspace(0.0, self.end, SAMPLES + 1), *(f.jumps(0.0, self.end) or ()))
        values = [f.value(float(t)) for t in times]
        large = max(values, key=abs)
        low, high = given or (
            (min(values), max(values)) if level else (-abs(large), abs(large)))
        # from the base value first to the limit that is farther away, or of the larger size
        base = min(max(values[0] if level else 0.0, low), high)
        up = high - base >= base - low if given is not None else large >= base
        return Varying(key, base, *((high, low) if up else (low, high)), level)
