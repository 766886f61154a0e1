"""Export of a run: one time series per body for ParaView, time histories, or all arrays."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.results.atomic_files import writing
from sparsemor.core.results.files.replaceable_files import own_files, remove
from sparsemor.core.results.files.written_files import in_the_way, read_listing
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.result_variables import FIELDS
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.export.export_plan import FORMATS, ExportPlan, plan_export
from sparsemor.plugins.export.histories import write_csv, write_netcdf
from sparsemor.plugins.export.vtk_and_xdmf import (
    BodySnapshot,
    VtuSeries,
    XdmfSeries,
    exported_mesh,
    frame_at,
)
from sparsemor.plugins.publishing.listed_files import publishing

EXPORT = "export"
"""Kind of the list of an export."""


class Series(Protocol):
    """Writer of the files of one body: `write` for each time, then `close` completes the files."""

    file: Path

    def write(self, step: int, time: float, frame: BodySnapshot) -> None: ...
    def close(self) -> None: ...


_WRITERS: Mapping[str, Callable[[Path, str, IntArray, int], Series]] = {
    "vtu": VtuSeries, "xdmf": XdmfSeries}
_OF_RUN: Mapping[str, tuple[str, Callable[[RunResult, IntArray, Path], int]]] = {
    "csv": ("histories.csv", write_csv), "nc": ("result.nc", write_netcdf)}


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """Files of an export. files: body -> file to open, or name of the run -> its one file; fields:
    body -> names of its fields; times: exported times, s; notes: requested fields that a body does
    not have."""

    folder: Path
    files: dict[str, Path]
    fields: dict[str, tuple[str, ...]]
    times: FloatArray
    notes: tuple[str, ...]


def export(
    run: RunResult, folder: str | Path, to: str = "vtu", *, bodies: Sequence[str] | None = None,
    fields: Sequence[str] | None = None, at: Sequence[float] | None = None, every: int = 1,
    force: bool = False,
) -> Exported:
    """Writes the deformed bodies in space, with displacement (m, space axes) and temperature (K) at
    the nodes; with the fields `stress` and `strain` their tensors in space axes and equivalent
    values (von Mises, Pa).

    One file to open per body: `body.pvd` with one .vtu file per time, or `body.xdmf` with binary
    data next to it. `csv`: one table of the time histories (histories.py); `nc`: all arrays as
    NetCDF. Every `every`-th stored step is written, or with `at` (s) the stored steps closest to
    these times. Only one time is in memory at once. `force` replaces the files of an
    earlier export, and nothing else.
    Raises InputError, before anything is written, for a format, body, field or time that does not
    exist and for a `folder` that is not empty.
    """
    plan = plan_export(run, to, bodies, fields, at, every)
    target = Path(folder).absolute()
    OutputDirectory(target).require_replaceable(
        force, "use --force to overwrite, or choose another --out", lambda: _is_export(target),
        "exports only, and this is something else")
    earlier = own_files(target)
    if earlier.changed:
        raise in_the_way(target, earlier.changed)
    made = not target.exists()
    try:
        OutputDirectory(target).make()
        with writing(target), publishing(target, EXPORT) as fresh:
            names = {body: _write(run, plan, body, fresh) for body in plan.fields}
            if to in _OF_RUN:
                name, write = _OF_RUN[to]
                write(run, plan.steps, fresh / name)
                names[Path(name).stem] = name
            remove(earlier, target)
    except BaseException:
        with suppress(OSError):
            if made:
                target.rmdir()
        raise
    files = {body: target / name for body, name in names.items()}
    return Exported(target, files, dict(plan.fields), run.times[plan.steps], plan.notes)


def _write(run: RunResult, plan: ExportPlan, body: str, folder: Path) -> str:
    series = _WRITERS[plan.format](folder, body, exported_mesh(run, body, plan.fields[body])[1],
                                   run.points(body).shape[1])
    for step in plan.steps.tolist():
        series.write(step, float(run.times[step]), frame_at(run, body, step, plan.fields[body]))
    series.close()
    return series.file.name


def _is_export(folder: Path) -> bool:
    """True if the folder contains an earlier export."""
    listing = read_listing(folder)
    return listing is not None and listing.kind == EXPORT


__all__ = ["FIELDS", "FORMATS", "Exported", "export"]
