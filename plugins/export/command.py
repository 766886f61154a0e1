"""Command `sparsemor export`: files of a stored run for other programs, FMUs of kept models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.results.model_file import is_model_file
from sparsemor.plugins.command_line.options import (
    At,
    Force,
    Json,
    Quiet,
    check_new_file,
    located_in,
    part_of,
    path_of,
    times_at,
    warn,
    words,
)

if TYPE_CHECKING:
    from sparsemor.core.results.run_result import RunResult


def export(
    source: Annotated[str, typer.Argument(
        metavar="RUN|MODEL", help="Directory of a run, finished or not, or file of a model.")],
    form: Annotated[str | None, typer.Option(
        "--to", help="Of a run vtu (the default) or xdmf for ParaView, csv (time histories) or nc "
        "(all arrays); of a model fmu (the default) or c, of a linear one npz, mat, mtx.")] = None,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="PATH",
        help="Directory for the files of a run (default: inside its directory), or file of an "
        "exported model (default: MODEL.fmu, ...; c and mtx: a new folder).")] = None,
    at: At = None,
    every: Annotated[int, typer.Option(
        "--every", help="Export every N-th stored step (not with --at).")] = 1,
    fields: Annotated[str | None, typer.Option(
        "--fields", help="Some of displacement,temperature,stress,strain (default: the first "
        "two).")] = None,
    bodies: Annotated[str | None, typer.Option(
        "--body", help="Bodies, such as disk,pad (default: all that have a mesh).")] = None,
    inputs: Annotated[str | None, typer.Option(
        "--inputs", help="Inputs of a model, keys of functions of time such as loads.push.factor "
        "(default: all).")] = None,
    outputs: Annotated[str | None, typer.Option(
        "--outputs", help="Outputs of a model, such as tip.x (default: all).")] = None,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Write the moving bodies of a stored run with their fields, for ParaView, its time histories
    or all its arrays; or a kept model as an FMU for co-simulation, a linear one also as matrices of
    its state space."""
    if is_model_file(Path(source)):
        _model(source, form or "fmu", out, inputs, outputs, force, as_json, quiet)
        return
    with located_in():
        from sparsemor.core.results.run_result import open_result
        from sparsemor.plugins.export import export as write

        if inputs or outputs:
            raise InputError("a run has no inputs and outputs: name the file of a model", "inputs")
        result, form = open_result(source), form or "vtu"
        folder = out or result.path.parent / form
        with part_of(result.path.parent, folder):
            done = write(
                result, folder, form, bodies=words(bodies), fields=words(fields),
                at=times_at(at), every=every, force=force)
        if as_json:
            print_json({
                "status": "done", "out": done.folder, "to": form, "times": len(done.times),
                "files": {b: str(f) for b, f in done.files.items()}, "fields": done.fields,
                "notes": done.notes})
        elif not quiet:
            for body, file in done.files.items():
                typer.echo(_line(result, body, file, done.fields[body], len(done.times))
                           if done.fields else f"{file}: {len(done.times)} times")
        if not quiet and not as_json:
            warn(done.notes)


def _model(
    source: str, form: str, out: Path | None, inputs: str | None, outputs: str | None, force: bool,
    as_json: bool, quiet: bool,
) -> None:
    """Exports a kept model to an FMU, C or matrices, and prints its inputs and outputs."""
    with located_in():
        from sparsemor.plugins.export.fmu import export_c, export_fmu
        from sparsemor.plugins.export.matrices import FORMATS, export_matrices
        from sparsemor.plugins.kept_models.reduced_model import load_model
        from sparsemor.plugins.publishing.listed_files import list_file

        if form not in ("fmu", "c", *FORMATS):
            raise InputError(f"a model is exported to fmu, c, {', '.join(FORMATS)} (got {form!r})",
                             "to")
        file = out or Path(f"{Path(source).stem}.{form}")
        check_new_file(file, force and form not in ("mtx", "c"))  # a folder is never replaced
        given = words(inputs), words(outputs)
        model = load_model(source)
        said: dict[str, Any] = {"status": "done", "out": str(file), "to": form}
        if form in ("fmu", "c"):
            unit = (export_fmu if form == "fmu" else export_c)(model, file, *given)
            said |= {"inputs": unit.inputs, "outputs": unit.outputs, "left_out": unit.left_out}
        else:
            made = export_matrices(model, file, form, *given)
            said |= {"inputs": made.inputs, "outputs": made.outputs, "unknowns": len(made.A)}
        if form not in ("mtx", "c"):
            list_file(file, alone=True)
        if as_json:
            print_json(said)
        elif not quiet:
            typer.echo(f"inputs: {', '.join(said['inputs']) or 'none'}\n"
                       f"outputs: {', '.join(said['outputs']) or 'none'}\n{form}: {file}")


def _line(run: "RunResult", body: str, file: Path, fields: tuple[str, ...], times: int) -> str:
    from sparsemor.plugins.export.vtk_and_xdmf import exported_mesh

    what = ", ".join(fields) or "no field"
    points = len(exported_mesh(run, body, fields)[0])
    return f"{file}: {points} points, {times} times, {what}"
