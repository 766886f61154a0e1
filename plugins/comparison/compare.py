"""Comparison of runs with a reference run: errors and computing times."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Protocol

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.json_data import to_json
from sparsemor.core.results.output_directory import COMPARISON
from sparsemor.core.results.presentation import CHARTS, Drawn
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.html import html_table
from sparsemor.plugins.comparison.cost import (
    Gain,
    RunFacts,
    gain_table,
    gains,
    pays_after,
    run_facts,
)
from sparsemor.plugins.comparison.error_norms import (
    START_UP,
    Errors,
    further_norms,
    measure_errors,
    measure_names,
)
from sparsemor.plugins.comparison.training_span import end_of_training, training_lines
from sparsemor.plugins.publishing.listed_files import publishing
from sparsemor.plugins.publishing.tables import (
    CONSTANT,
    MARK,
    csv_table,
    marked,
    number,
    text_table,
)

REFERENCE = "reference"
NONE: Mapping[str, str] = {}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Comparison(Drawn):
    """Errors and cost of runs relative to a reference run; `str()` returns the table.

    runs, measured: run name -> result, errors; name: label of the reference: its reducer, or
    "reference" if a run has that name; limit: errors above it (relative; rad for angles) are
    marked; failed: run that has no result -> reason.
    """

    reference: RunResult
    runs: Mapping[str, RunResult]
    measured: Mapping[str, Errors]
    name: str = REFERENCE
    limit: float = LIMIT
    failed: Mapping[str, str] = field(default_factory=dict)

    @property
    def above_limit(self) -> dict[str, dict[str, float]]:
        """Run -> measure (combined, fields, angle_rad) -> error that exceeds `limit`; runs without
        such an error are absent."""
        return {run: found for run, e in self.measured.items() if (found := e.above(self.limit))}

    @property
    def errors(self) -> dict[str, dict[str, float]]:
        """Run -> measure (combined, fields, `body.field`, angle_rad) -> maximum error over time."""
        return {run: e.worst for run, e in self.measured.items()}

    @property
    def late_errors(self) -> dict[str, dict[str, float]]:
        """Run -> measure -> maximum error from the time `errors_from` on."""
        return {run: e.worst_late for run, e in self.measured.items()}

    @property
    def series(self) -> dict[str, Mapping[str, FloatArray]]:
        """Run -> measure -> (j,) error at the times `measured[run].times`."""
        return {run: e.series for run, e in self.measured.items()}

    @property
    def effectivity(self) -> dict[str, dict[str, float]]:
        """Run -> block or field -> largest error that the run estimated for itself, divided by its
        largest error; runs without an estimate are absent."""
        return {run: found for run, e in self.measured.items() if (found := e.effectivity)}

    @property
    def facts(self) -> dict[str, RunFacts]:
        """Run -> cost (computing times, iterations, basis vectors, sampled rows); the reference
        comes first."""
        return {name: run_facts(run) for name, run in self._all().items()}

    @property
    def pays_after(self) -> dict[str, int | None]:
        """Run -> break-even number of online runs, after which offline plus online time is less
        than the time of as many reference runs.

        None if it is never reached, or if the run or the reference did not reach its end.
        """
        facts = self.facts
        return {run: pays_after(facts[self.name], facts[run]) for run in self.runs}

    @property
    def trained_to(self) -> float:
        """End of training, s, if it is before the end of the runs; else 0."""
        return end_of_training(self.reference, self.runs.values())

    @property
    def gains(self) -> dict[str, Gain]:
        """Run -> wall-clock gain over the reference."""
        return gains(self.facts, self.name)

    def failed_lines(self) -> list[str]:
        """Lines on the runs that have no result."""
        return [f"failed: {name}: {why}" for name, why in self.failed.items()]

    @property
    def notes(self) -> dict[str, str]:
        """Run -> note on a comparison that is incomplete in time or in blocks, and on a run that
        went on at full order; absent for others."""
        end = float(self.reference.times[-1])
        found = {}
        for run, e in self.measured.items():
            parts = [f"{self.runs[run].status.value}, compared up to {e.until:.6g} s of {end:.6g} s"
                     ] if e.until < end * (1.0 - 1e-9) else []
            if e.unshared:
                parts.append("not compared, because only one run has them or their sizes differ: "
                             + ", ".join(e.unshared))
            if fall_back := self.runs[run].summary.get("fall_back"):
                parts.append(f"{fall_back['steps']} steps from {fall_back['time']:.4g} s on at "
                             "full order")
            if parts:
                found[run] = f"{run}: {'; '.join(parts)}"
        return found

    def __repr__(self) -> str:
        errors = ", ".join(f"{run} {e.worst.get('combined', float('nan')):.1e}"
                           for run, e in self.measured.items())
        return f"<Comparison with {self.name}: combined errors {errors}>"

    def _repr_html_(self) -> str:
        """Table of errors and cost, for notebooks."""
        fields = measure_names(self.reference.layout.kinds)
        notes = "".join(f"<p>{escape(text)}</p>" for text in (
            *self._limit_lines(), *self.notes.values()))
        return html_table(self._table(self._fields(fields)), "errors and cost") + notes

    def __str__(self) -> str:
        fields = self._fields(measure_names(self.reference.layout.kinds))
        late = next((e.late_from for e in self.measured.values() if e.late_from > 0.0), 0.0)
        phases = ["", phase_table(self.measured, self._blocks(), self.limit)]
        gain = ["", gain_table(found)] if (found := self.gains) else []
        return "\n".join([text_table(self._table(fields)), *self._late_lines(late, fields), *phases,
                          *self._estimate_lines(), *gain, *self._limit_lines(),
                          *self.notes.values(), *training_lines(self.reference, self.runs),
                          *self.failed_lines()])

    def _fields(self, measures: Sequence[str]) -> list[str]:
        return [f for f in measures if any(f in e.worst for e in self.measured.values())]

    def _table(self, fields: Sequence[str]) -> list[list[str]]:
        """Header, and errors and cost of each run."""
        facts, pays = self.facts, self.pays_after
        base = facts[self.name].ms_per_step
        head = ["run", "reducer", "status", "ms/step", "speed-up", "iterations", "atoms", "rows",
                "offline s", "pays after"]
        table = [[*head, *(f.replace("_", " ") for f in fields)]]
        for name, f in facts.items():
            errors = self.errors.get(name, {})
            label = f"{name} (reference)" if name == self.name != REFERENCE else name
            table.append([
                label, f.reducer, f.status.value, number(f.ms_per_step, ".3g"),
                _ratio(base, f.ms_per_step), number(f.iterations, ".2f"), f.atoms_text, str(f.rows),
                number(f.offline_whole_seconds, ".3g"), number(pays.get(name), "d"),
                *(self._error(name, errors, field) for field in fields)])
        if all(name == f.reducer for name, f in facts.items()):
            return [[row[0], *row[2:]] for row in table]  # the second column repeats the first
        return table

    def to_json(self) -> str:
        """JSON text with errors, times and counts of every run."""
        pays, found = self.pays_after, self.gains
        runs = {name: f.as_dict() | {"pays_after": pays.get(name),
                                     "errors": self.errors.get(name, {}),
                                     "late_errors": self.late_errors.get(name, {}),
                                     "above_limit": self.above_limit.get(name, {}),
                                     "constant": self._constant(name),
                                     "effectivity": self.effectivity.get(name, {}),
                                     "wall_clock_gain": found[name]._asdict()
                                     if name in found else {},
                                     **self._phases(name),
                                     "note": self.notes.get(name, "")}
                for name, f in self.facts.items()}
        return to_json({"reference": self.name, "runs": runs}).decode()

    def write(
        self, directory: str | Path, charts: bool = True,
        report: Callable[[Path], None] | None = None,
    ) -> list[Path]:
        """Writes errors.csv, start_up.csv, error_over_time.csv and, with `charts`, what the
        installed `Charts` draw; returns their paths. report: called with the path of each chart's
        file. Raises InputError instead of replacing files that are not ours."""
        folder = Path(directory)
        tables = {"errors.csv": self._error_rows(), "start_up.csv": phase_rows(self.measured),
                  "error_over_time.csv": self._series_rows()}
        with publishing(folder, COMPARISON) as fresh:
            for name, rows in tables.items():
                (fresh / name).write_text(csv_table(rows), encoding="utf-8")
        written = [folder / name for name in tables]
        if not charts:
            return written
        for drawing in installed_charts():
            with publishing(folder) as fresh:
                for file in drawing.write_charts(self, fresh):
                    written.append(folder / file.relative_to(fresh))
                    if report is not None:
                        report(written[-1])
        return written

    def _all(self) -> dict[str, RunResult]:
        return {self.name: self.reference, **self.runs}

    def _blocks(self) -> list[str]:
        return [b.name for b in self.reference.layout.differential]

    def _phases(self, name: str) -> dict[str, dict[str, float]]:
        e = self.measured.get(name)
        return {} if e is None else {
            "start_up": e.start_up, "steady": e.steady,
            "start_up_present": e.start_up_present, "steady_present": e.steady_present}

    def _late_lines(self, late: float, fields: list[str]) -> list[str]:
        if late <= 0.0:
            return []
        table = [[f"from {late:g} s", *(f.replace("_", " ") for f in fields)]]
        table += [[run, *(self._error(run, e, f) for f in fields)]
                  for run, e in self.late_errors.items()]
        return ["", text_table(table)]

    def _estimate_lines(self) -> list[str]:
        """Table of estimated errors, each as a multiple of the error."""
        found = self.effectivity
        if not found:
            return []
        blocks = [b for b in self._blocks() if any(b in e for e in found.values())]
        table = [["estimate / error", *blocks]]
        table += [[run, *(number(e.get(b), ".3g") for b in blocks)] for run, e in found.items()]
        return ["", text_table(table)]

    def _error_rows(self) -> list[list[Any]]:
        """Rows of errors.csv: a heading, then cost and largest error of each run by each measure;
        empty cells for the reference, and for what a run does not have."""
        measures = ["combined", *self._blocks(), "angle_rad", *further_norms()]
        rows: list[list[Any]] = [
            ["run", "status", "ms_per_step", "offline_s", "offline_whole_s", "online_s",
             "pays_after", *measures, "above_limit", "constant"]]
        break_even = self.pays_after
        for name, cost in self.facts.items():
            errors = self.errors.get(name, {})
            rows.append([name, cost.status.value, cost.ms_per_step, cost.offline_seconds,
                         cost.offline_whole_seconds, cost.online_seconds, break_even.get(name),
                         *(errors.get(m) for m in measures),
                         " ".join(self.above_limit.get(name, {})), " ".join(self._constant(name))])
        return rows

    def _error(self, run: str, errors: Mapping[str, float], measure: str) -> str:
        """An error as text, marked if it is above the limit; a word for a block that does not
        change in the reference."""
        e = self.measured.get(run)
        constant = e is not None and e.still(measure)
        return CONSTANT if constant else marked(errors.get(measure), ".2e", self.limit)

    def _constant(self, run: str) -> list[str]:
        """Blocks and fields that do not change in the reference: their errors have no scale."""
        return sorted(self.measured[run].constant) if run in self.measured else []

    def _limit_lines(self) -> list[str]:
        above = self.above_limit
        if not above:
            return []
        worst = [f"{run} ({', '.join(f'{m} {e:.2g}' for m, e in found.items())})"
                 for run, found in above.items()]
        return [f"{MARK} above {self.limit:g}: {len(above)} of {len(self.runs)} runs: "
                f"{'; '.join(worst)}"]

    def _series_rows(self) -> list[list[Any]]:
        """Table of each error over time; suffix `_present`: relative to the reference's norm at the
        same time."""
        measures = sorted({m for e in self.measured.values() for m in e.series})
        present = sorted({m for e in self.measured.values() for m in e.present} - {"combined"})
        rows: list[list[Any]] = [["run", "time_s", *measures, *(f"{m}_present" for m in present)]]
        for run, e in self.measured.items():
            columns = [e.series[m].tolist() for m in measures]
            columns += [e.present[m].tolist() for m in present]
            rows += [[run, *values] for values in zip(e.times.tolist(), *columns, strict=True)]
        return rows


class Charts(Protocol):
    """Charts of comparisons: entry points of the group `sparsemor.charts` refer to a module or an
    object of this form."""

    def usual_files(self, labels: Sequence[str]) -> list[str]:
        """Names of the files that charts of runs with these labels usually have: `sparsemor
        compare` refuses a directory with other files of these names before the first run."""
        ...

    def write_charts(self, comparison: Comparison, folder: Path) -> Iterator[Path]:
        """Writes the charts that apply to a comparison into an empty folder, from where they are
        moved to the directory of the comparison; yields the path of each when it is written."""
        ...


def installed_charts() -> list[Charts]:
    """Charts of the installed distributions. Raises InputError if one cannot be imported."""
    registry = Registry()
    return [registry.load(CHARTS, registry.spelling(p)) for p in registry.names(CHARTS)]


def compare(
    reference: RunResult, *, errors_from: float | None = None, error_limit: float = LIMIT,
    failed: Mapping[str, str] = NONE, **runs: RunResult
) -> Comparison:
    """Comparison of runs with a reference run.

    errors_from: time, s, from which late errors are evaluated in addition, by default the end of
    training if the runs are longer; error_limit: errors above it are marked; failed: run without
    a result -> reason. Raises InputError when a run has no unknowns or times in common with the
    reference.
    """
    if not runs:
        raise InputError("name at least one run in addition to the reference")
    measured = {}
    late = end_of_training(reference, runs.values()) if errors_from is None else errors_from
    for name, run in runs.items():
        try:
            measured[name] = measure_errors(reference, run, late)
        except InputError as fault:
            raise fault.under(name) from None
    name = REFERENCE if reference.reducer in runs else reference.reducer
    return Comparison(reference, runs, measured, name, error_limit, failed)


def _ratio(base: float | None, own: float | None) -> str:
    return f"{base / own:.3g}" if base and own else "-"


def phase_table(
    measured: Mapping[str, Errors], blocks: list[str], limit: float = LIMIT
) -> str:
    """Text table with one line per run: `start-up / steady` maximum of the combined error and of
    each block.

    The combined error is relative to the norm at the same time, the error of a block to its largest
    change. `-`: no common times in that phase. Errors above `limit` are marked.
    """
    end = next((e.start_up_end for e in measured.values()), 0.0)
    head = [f"first {START_UP:.0%} / rest", "combined", *blocks]
    table = [[run, *(CONSTANT if e.still(m) else
                     _pair(e.start_up.get(m), e.steady.get(m), limit) for m in head[1:])]
             for run, e in measured.items()]
    note = f"start-up until {end:.4g} s; relative to the norm at the same time: start_up.csv"
    return "\n".join([text_table([head, *table]), note])


def phase_rows(measured: Mapping[str, Errors]) -> list[list[object]]:
    """Rows of start_up.csv, one per run and error measure.

    Suffix `_present`: relative to the reference's norm at the same time, as in the combined error
    of the paper; empty for measures without such a norm.
    """
    rows: list[list[object]] = [
        ["run", "measure", "start_up", "steady", "start_up_present", "steady_present"]]
    for run, e in measured.items():
        phases = e.start_up, e.steady, e.start_up_present, e.steady_present
        rows += [[run, m, *(phase.get(m) for phase in phases)] for m in e.series]
    return rows


def _pair(start_up: float | None, steady: float | None, limit: float) -> str:
    return " / ".join(marked(v, ".1e", limit) for v in (start_up, steady))


__all__ = ["Charts", "Comparison", "Errors", "compare", "installed_charts"]
