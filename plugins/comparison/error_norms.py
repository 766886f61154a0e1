"""Error norms of one run relative to another: Eq. 34 of the paper, and one error per block of
unknowns.

The combined error divides by the norm of all unknowns together, so that temperatures of 300 K and
rigid displacements of metres conceal the elastic error. Each block is therefore also measured
relative to its own change; entry points of the group `sparsemor.error_norm` add further norms,
which every table and chart of errors then has. Where the solution starts from zero, errors relative
to the instantaneous norm are large for a few steps, so the start-up is reported separately.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import Block, FieldKind, Quantity
from sparsemor.core.protocols.poses import KNOWN as POSE_SIZES
from sparsemor.core.protocols.poses import angle_between
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.relative_error_estimates import (
    CONSTANT_CHANGE,
    LIMIT,
    constant_change,
    row_norms,
)
from sparsemor.core.results.run_result import RunResult

TIME_MATCH = 1e-9
START_UP = 0.02
"""Fraction of the reference's time span that counts as start-up."""
ERROR_NORM = "error_norm"
"""Group of the entry points of further error norms."""
ErrorNorm: TypeAlias = Callable[[RunResult, RunResult, IntArray, IntArray], FloatArray]
"""An error norm: function(reference, run, here, there) -> relative errors (j,) at the stored steps
`here` (j,) of the reference and `there` (j,) of the run, which are at the same times; the runs may
be of other models (`common_blocks`)."""
_BATCH_ENTRIES = 2**21


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of one run relative to a reference, at their common stored times.

    times (j,): s; series: name -> (j,) error at each time. Names: `combined` (Eq. 34), each block
    `body.field`, each field (maximum over its blocks), `angle_rad`, and further norms
    (`further_norms`); blocks: the names `body.field`; late_from: time from which late errors are
    evaluated, s; present: the series of `combined`, blocks and fields relative to the norm of the
    reference at the same time; start_up_end: end of the start-up, s; constant: names of blocks and
    fields that do not change in the reference, whose errors are relative to their norm; least:
    relative change up to which they count as such; unshared: blocks that only one of the runs has,
    or that differ in size, and that are not compared; estimated: the series of those blocks and
    fields whose error the run estimated, by the estimate instead of the reference.
    """

    times: FloatArray
    series: Mapping[str, FloatArray]
    blocks: frozenset[str] = frozenset()
    late_from: float = 0.0
    present: Mapping[str, FloatArray] = field(default_factory=dict)
    start_up_end: float = 0.0
    unshared: tuple[str, ...] = ()
    constant: frozenset[str] = frozenset()
    least: float = CONSTANT_CHANGE
    estimated: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def effectivity(self) -> dict[str, float]:
        """Name -> maximum over time of the estimated error, divided by that of the error; without
        those that have no error."""
        return {n: float(e.max()) / error for n, e in self.estimated.items()
                if (error := self.worst[n]) > 0.0}

    @property
    def until(self) -> float:
        """Last common time, s."""
        return float(self.times[-1])

    @property
    def worst(self) -> dict[str, float]:
        """Name -> maximum error over time."""
        return _largest(self.series, slice(None))

    @property
    def worst_late(self) -> dict[str, float]:
        """Name -> maximum error from `late_from` on; empty if the runs have no such time in
        common."""
        return _largest(self.series, self.times >= self.late_from)

    @property
    def start_up(self) -> dict[str, float]:
        """Name -> maximum error during the start-up, the first 2 % of the reference's time span.

        The initial time is excluded; empty if the runs have no other time of the start-up in
        common.
        """
        return _largest(self.series, self._early)

    @property
    def steady(self) -> dict[str, float]:
        """Name -> maximum error after the start-up."""
        return _largest(self.series, self.times > self.start_up_end)

    @property
    def start_up_present(self) -> dict[str, float]:
        """Name -> maximum instantaneous relative error during the start-up."""
        return _largest(self.present, self._early)

    @property
    def steady_present(self) -> dict[str, float]:
        """Name -> maximum instantaneous relative error after the start-up."""
        return _largest(self.present, self.times > self.start_up_end)

    @property
    def _early(self) -> BoolArray:
        early: BoolArray = (self.times > self.times[0]) & (self.times <= self.start_up_end)
        return early

    def still(self, name: str) -> bool:
        """True if a block or field is constant both in the reference and in the run."""
        return name in self.constant and self.worst.get(name, 0.0) <= self.least

    def above(self, limit: float = LIMIT) -> dict[str, float]:
        """Name -> maximum error of those quantities (combined error, fields, angles) whose error
        exceeds `limit` (relative; rad for `angle_rad`)."""
        return {m: e for m, e in self.worst.items() if m not in self.blocks and e > limit}


def measure_errors(reference: RunResult, run: RunResult, late_from: float = 0.0) -> Errors:
    """Errors of `run` relative to `reference` at their common stored times; only a few steps are in
    memory at once.

    Combined error: |q_ref - q| / |q_ref|, q: all unknowns except multipliers; 0 where q_ref = 0.
    Error of a block: |x_ref - x|(t) / max over t of |x_ref - x_ref(0)|; if the reference is
    constant (that change is at most `constant_change` of max |x_ref|), relative to max |x_ref|, and
    absolute if that is 0 too. Instantaneous relative error of a block: |x_ref - x|(t) / |x_ref|(t),
    0 where x_ref = 0. Error of a field: the maximum over its blocks. angle_rad: maximum error over
    the rotations of all bodies, rad.
    late_from: time from which late errors are evaluated, s.

    Blocks that only one of the runs has are not compared (`unshared`). Raises InputError when the
    runs have no time, or no block, in common.
    """
    blocks, unshared = common_blocks(reference, run)
    here, there = common_steps(reference.times, run.times)
    error = {b.name: np.zeros(len(here)) for b in blocks}
    size = {b.name: np.zeros(len(here)) for b in blocks}
    scale = {b.name: 0.0 for b in blocks}
    angle = np.zeros(len(here))
    turning_frames = [
        b for b in blocks if b.kind.quantity is Quantity.POSE and b.size in POSE_SIZES and (
            # else a massless frame of a joint
            b.owner in reference.scene.get("bodies", (b.owner,)))]
    for b in blocks:
        start = reference.block(b.name, slice(0, 1))
        for part in _batches(len(here), b.size):
            x_ref = reference.block(b.name, here[part])
            difference = x_ref - run.block(b.name, there[part])
            error[b.name][part], size[b.name][part] = row_norms(difference), row_norms(x_ref)
            scale[b.name] = max(scale[b.name], float(row_norms(x_ref - start).max()))
            if b in turning_frames:
                angle[part] = np.maximum(
                    angle[part], angle_between(x_ref, x_ref - difference))
    constant_limit = constant_change(reference.scene)
    constant_blocks = {name for name in scale
                       if scale[name] <= constant_limit * float(size[name].max())}
    for name in constant_blocks:
        scale[name] = float(size[name].max()) or 1.0
    fields = {b.field for b in blocks}
    constant_fields = {f for f in fields
                       if all(b.name in constant_blocks for b in blocks if b.field == f)}
    times = reference.times[here]
    series = {"combined": _combined(list(error.values()), list(size.values()))}
    series |= _per_field(blocks, {name: e / scale[name] for name, e in error.items()})
    if turning_frames:
        series["angle_rad"] = angle
    series |= {name: norm(reference, run, here, there) for name, norm in further_norms().items()}
    instantaneous = {name: _ratio(e, size[name]) for name, e in error.items()}
    estimated = {name: run.error_estimate(name)[there] / scale[name]
               for name in run.error_estimates if name in error}
    return Errors(
        times, series, blocks=frozenset(error), late_from=late_from,
        present={"combined": series["combined"], **_per_field(blocks, instantaneous)},
        start_up_end=_start_up_end(reference.times), unshared=unshared,
        constant=frozenset(constant_blocks | constant_fields), least=constant_limit,
        estimated=_per_field([b for b in blocks if b.name in estimated], estimated))


def _largest(series: Mapping[str, FloatArray], when: BoolArray | slice) -> dict[str, float]:
    """Name -> maximum of its series over some of the times; without those that have none there."""
    return {name: float(e[when].max()) for name, e in series.items() if e[when].size}


def further_norms() -> dict[str, ErrorNorm]:
    """Error norms of the installed distributions, by name."""
    registry = Registry()
    return {p.name: registry.load(ERROR_NORM, registry.spelling(p))
            for p in registry.names(ERROR_NORM)}


def measure_titles(kinds: Iterable[FieldKind]) -> dict[str, str]:
    """Name of each error of a whole run -> title in charts, in the order of tables: combined,
    fields, angle, further norms."""
    return {"combined": "all unknowns together", **{k.name: k.label for k in kinds if k.order > 0},
            "angle_rad": "angle", **{n: n.replace("_", " ") for n in further_norms()}}


def measure_names(kinds: Iterable[FieldKind]) -> tuple[str, ...]:
    """Names of the errors of a whole run, in the order of tables."""
    return tuple(measure_titles(kinds))


def common_steps(reference: FloatArray, run: FloatArray) -> tuple[IntArray, IntArray]:
    """Indices of the steps of both runs at the same times, equal within 1e-9 of the end time of the
    longer run.

    Raises InputError if the runs have no stored time in common.
    """
    if len(reference) and len(run):
        # nearest reference step of each step of the run
        after = np.clip(np.searchsorted(reference, run), 1, max(1, len(reference) - 1))
        before = after - 1
        after = np.minimum(after, len(reference) - 1)
        left = np.abs(reference[before] - run) <= np.abs(reference[after] - run)
        nearest = np.where(left, before, after)
        close = TIME_MATCH * max(abs(float(reference[-1])), abs(float(run[-1])))
        there = np.flatnonzero(np.abs(reference[nearest] - run) <= close)
        if there.size:
            return nearest[there].astype(np.int64), there.astype(np.int64)
    raise InputError(
        f"the runs have no stored time in common ({_span(reference)}; {_span(run)}): store both "
        "with steps that meet, time.step and output.every")


def _span(times: FloatArray) -> str:
    if len(times) < 2:
        return f"{len(times)} stored steps"
    return f"{len(times)} steps from {times[0]:g} s, next {times[1]:g} s, to {times[-1]:g} s"


def common_blocks(
    reference: RunResult, run: RunResult
) -> tuple[list[Block], tuple[str, ...]]:
    """Blocks of equal name and size, in the order of the reference, and names of all other
    blocks."""
    blocks = reference.layout.differential
    sizes = {b.name: b.size for b in run.layout.differential}
    common = [b for b in blocks if sizes.get(b.name) == b.size]
    shared = {b.name for b in common}
    odd = [b for b in (*blocks, *run.layout.differential) if b.name not in shared]
    if not common:
        listed = ", ".join(sorted({f"{b.name} ({b.size})" for b in odd}))
        raise InputError(f"the runs have no unknowns in common: {listed}")
    return common, tuple(sorted({b.name for b in odd}))


def _batches(count: int, size: int) -> Iterator[slice]:
    """Ranges of `count` steps, each of at most `_BATCH_ENTRIES` values of blocks of this size."""
    steps = max(1, _BATCH_ENTRIES // size)
    for start in range(0, count, steps):
        yield slice(start, min(count, start + steps))


def _combined(errors: list[FloatArray], sizes: list[FloatArray]) -> FloatArray:
    """Error norm (T,) of all blocks together relative to that of the reference, from the norms (T,)
    of each block."""
    error, size = row_norms(np.stack(errors, axis=1)), row_norms(np.stack(sizes, axis=1))
    return _ratio(error, size)


def _ratio(error: FloatArray, size: FloatArray) -> FloatArray:
    """error / size (T,), 0 where the size is 0; at most the largest float."""
    with np.errstate(over="ignore"):  # a diverged run over a start from almost nothing
        ratio = np.divide(error, size, out=np.zeros_like(error), where=size > 0.0)
    return np.minimum(ratio, np.finfo(np.float64).max)


def _start_up_end(times: FloatArray) -> float:
    """End of the start-up, s: `START_UP` of the time span."""
    span = float(times[-1] - times[0])
    return float(times[0]) + START_UP * span + TIME_MATCH * span  # a step at 2 % belongs to it


def _per_field(blocks: list[Block], by_block: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Series (T,) of each field, the maximum over its blocks, and those of the blocks."""
    fields: dict[str, FloatArray] = {}
    for b in blocks:
        earlier = fields.get(b.field)
        now = by_block[b.name]
        fields[b.field] = now if earlier is None else np.maximum(earlier, now)
    return fields | by_block
