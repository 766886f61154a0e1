"""Command `sparsemor init`: a commented scene for a mesh file of one's own, to begin with."""

import json
import os
import re
import sys
from dataclasses import dataclass
from io import StringIO
from math import floor, log10, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.plugins.command_line.options import Json, Quiet, located_in, path_of

if TYPE_CHECKING:
    from sparsemor.core import Mesh

LONG = 10.0
"""Largest extent of a mesh file, in its own unit, from which this is taken for millimetres."""
PER_PERIOD, PERIODS, RATIO = 50, 4, 0.02
"""Steps for a period of the first vibration, periods of the run, damping ratio of the vibration."""
STEP, STEPS = 1.0e-3, 100
"""Time step, s, and number of steps where the first vibration is not known."""
G = 9.81
TEMPLATE = """\
format: 1
title: {name}

bodies:
  {name}:
    use: flexible
    mesh: {{use: file, path: {path}, scale: {scale:g}}}   # metres for a unit of the file: {size} m
    # sets of the file: {listed}
{own}    {thickness}material:                                # steel
      {{rho: 7850, E: 2.1e+11, nu: 0.3, alpha: 1.2e-5, k: 45, c: 480}}   # kg/m3, Pa, SI units
    fields: {fields}
    reference: {{clamp: {hold}}}                 # these points do not move
    frame: fixed                             # leave it out for a body that moves, and add joints
    damping: {{stiffness: {damping:.2g}}}              # s: {ratio:g} % of the first vibration

loads:
{loads}
time: {{end: {end:g}, step: {step:g}}}              # s: {why}
integrator: {{use: generalized_alpha, rho_inf: 0.8}}
reducer: full                                # then galerkin or auto: `sparsemor compare {file}`

probes:
  {probe}: {{body: {name}, at: {at}}}
"""


def init(
    mesh: Annotated[Path, typer.Argument(
        metavar="MESH", parser=path_of, help="Mesh file: msh, inp, vtk, vtu, bdf, mesh, med.")],
    hold: Annotated[str | None, typer.Option(
        "--hold", metavar="SET", help="Set of the mesh that does not move.")] = None,
    load: Annotated[str | None, typer.Option(
        "--load", metavar="SET", help="Set on which a force acts (default: weight alone).")] = None,
    heat: Annotated[str | None, typer.Option(
        "--heat", metavar="SET", help="Surface that is heated (default: none).")] = None,
    scale: Annotated[float | None, typer.Option(
        "--scale", help="Metres for a unit of the file (default: by its size).")] = None,
    thickness: Annotated[float, typer.Option(
        "--thickness", min=0.0, help="Thickness of a plane body, m.")] = 0.01,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="FILE",
        help="Scene file (default: MESH with the ending .yaml).")] = None,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Write a commented scene for a mesh file, which runs as it is; asks for the sets that options
    do not name."""
    file = out or mesh.with_suffix(".yaml")
    with located_in():
        if os.path.lexists(file):
            raise InputError(f"{file} exists: choose another file", "out")
        if not file.absolute().parent.is_dir():
            raise InputError(f"there is no folder {file.parent}", "out")
        begun = MeshWithSets.read(mesh, scale)
        asked = sys.stdin.isatty() and not (as_json or quiet)
        if asked and begun.sets:
            typer.echo(begun.listed)
            hold = hold or _answer(begun, "held", hold)
            load = load or _answer(begun, "loaded (none: weight alone)", "none")
            heat = heat or _answer(begun, "heated", "none")
        held, pushed, heated = (begun.chosen(option, name) for option, name in (
            ("hold", hold or ("" if begun.sets else "lower_end")),
            ("load", load), ("heat", heat)))
        text, facts = begun.scene(held, pushed, heated, thickness, file)
        with open(file, "x", encoding="utf-8") as stream:
            stream.write(text)
    if as_json:
        print_json({"status": "done", "out": str(file), "scale": begun.scale, **facts})
    elif not quiet:
        typer.echo(f"wrote {file}: {begun.size} m, {begun.listed}\nnext: sparsemor run {file}")


def _answer(begun: "MeshWithSets", use: str, default: str | None) -> str | None:
    """Name of a set, asked for until it is one; None for none."""
    while True:
        name = typer.prompt(f"Which set is {use}?", default=default or begun.smallest)
        if name == "none" and default == "none":
            return None
        if name in begun.sets:
            return str(name)
        typer.echo(suggestions(name, list(begun.sets)))


@dataclass(frozen=True, slots=True, eq=False)
class MeshWithSets:
    """A mesh file, the metres of its unit, its sets and their numbers of points."""

    path: Path
    mesh: "Mesh"
    scale: float
    sets: dict[str, int]

    @classmethod
    def read(cls, path: Path, scale: float | None) -> "MeshWithSets":
        """Reads the file. Raises InputError where it cannot be used."""
        plugin: Any = Registry().get("mesh", "file")
        try:
            mesh = plugin(path=path.name, scale=scale or 1.0).build(path.absolute().parent)
        except InputError as error:
            raise InputError("; ".join(f.message for f in error.faults)) from None
        extent = float((mesh.points.max(axis=0) - mesh.points.min(axis=0)).max())
        if scale is None and extent > LONG:
            scale = 1.0e-3
            mesh = plugin(path=path.name, scale=scale).build(path.absolute().parent)
        count = len(mesh.points)
        return cls(path, mesh, scale or 1.0,
                   {n: len(p) for n, p in mesh.point_sets.items() if len(p) < count})

    @property
    def smallest(self) -> str:
        return min(self.sets, key=lambda n: self.sets[n])

    @property
    def size(self) -> str:
        """Extents, m."""
        extents = self.mesh.points.max(axis=0) - self.mesh.points.min(axis=0)
        return " x ".join(f"{e:.3g}" for e in extents)

    @property
    def listed(self) -> str:
        """Sets with their numbers of points."""
        return ", ".join(f"{n} ({k} points)" for n, k in self.sets.items()) or (
            "none: two are made below by a condition")

    def chosen(self, option: str, name: str | None) -> str | None:
        """The name of a set. Raises InputError for another one."""
        if name is None or name in self.sets or not self.sets and name == "lower_end":
            return name
        if not name:
            raise InputError(f"give a set of {self.path.name}: {self.listed}", option)
        raise InputError(f"{self.path.name} has no set {name!r}: "
                         f"{suggestions(name, list(self.sets), 'sets')}", option)

    def scene(
        self, hold: str | None, load: str | None, heat: str | None, thickness: float, out: Path
    ) -> tuple[str, dict[str, Any]]:
        """Text of the scene, and mass (kg) and first frequency (Hz) of its body, which its force
        and its steps are made for. Raises InputError where such a body cannot be."""
        from sparsemor.core.scene.scene import load as loaded
        from sparsemor.core.simulation.validation import checked_model
        from sparsemor.plugins.commands.body_summary import body_facts

        name = re.sub(r"\W+", "_", self.path.stem)
        name = name if re.match(r"[A-Za-z]", name) else f"body_{name}"
        # first with any force, to learn mass and frequency, then with those that suit them
        first = self._written(name, hold, load, heat, thickness, out, 1.0, None)
        scene = loaded(_parsed(first) | {"output": {}}, {
            f"bodies.{name}.mesh.path": str(self.path.absolute())})
        facts = body_facts(checked_model(scene), scene.bodies)[name]
        found = {"mass": facts.mass, "frequency": next(iter(facts.frequencies), None)}
        return self._written(name, hold, load, heat, thickness, out, G * (facts.mass or 1.0),
                             found["frequency"]), found

    def _written(
        self, name: str, hold: str | None, load: str | None, heat: str | None, thickness: float,
        out: Path, force: float, frequency: float | None,
    ) -> str:
        """Text of the scene file, with numbers that suit the size and the first frequency of the
        body. hold, load, heat: names of sets, None if there is none to hold, to push or to heat;
        force: N; frequency: Hz, None if it is not known."""
        d = self.mesh.dimension
        at = "tip" if not self.sets else load or hold
        step = STEP if not frequency else _round(1.0 / (PER_PERIOD * frequency))
        end = (STEPS if not frequency else PER_PERIOD * PERIODS) * step
        why = (f"{PER_PERIOD} steps for a period of the first vibration, {frequency:.3g} Hz"
               if frequency else "take about 50 steps for a period of the first vibration")
        loads = [f"  weight: {{use: gravity, g: [{_vector(-G, d)}]}}   # m/s2"]
        if load:
            loads.append(f"  push: {{use: point_force, on: {_quoted(f'{name}:{load}')}, "
                         f"force: [{_vector(-_round(force), d)}], "
                         f"factor: {{use: smooth_step, end: {_round(end / 4):g}, final: 1.0}}}}"
                         "   # N: the weight of the body, along the second axis")
        if heat:
            on = _quoted(f"{name}:{heat}")
            loads.append(f"  heat: {{use: heat_flux, on: [{on}], flux: 1.0e+4}}   # W/m2")
        own = "" if self.sets else self._own_sets()
        return TEMPLATE.format(
            name=name, path=_quoted(os.path.relpath(self.path, out.absolute().parent)),
            scale=self.scale, size=self.size, listed=self.listed, own=own,
            hold=_quoted(hold or ""),
            thickness=f"thickness: {thickness:g}                          # m\n    " if d == 2
            else "", fields="[elastic, thermal]" if heat else "[elastic]"
            "                        # and thermal, for heat",
            damping=2.0 * RATIO / (2.0 * pi * frequency) if frequency else 1.0e-5,
            ratio=100.0 * RATIO, loads="\n".join(loads) + "\n", end=end, step=step, why=why,
            file=out, probe="end", at=_quoted(at or ""))

    def _own_sets(self) -> str:
        """Sets at the two ends along x, for a mesh without sets."""
        low, high = self.mesh.points[:, 0].min(), self.mesh.points[:, 0].max()
        near = 0.02 * (high - low)
        return (f'    sets:\n      lower_end: {{where: "x < {low + near:.6g}"}}\n'
                f'      tip: {{where: "x > {high - near:.6g}"}}\n')


def _vector(y: float, d: int) -> str:
    return ", ".join(f"{v:g}" for v in (0.0, y, 0.0)[:d])


def _round(value: float) -> float:
    """The nearest smaller number of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** floor(log10(value))
    return float(f"{next(n for n in (5, 2, 1) if value >= 0.999 * n * power) * power:.6g}")


def _quoted(text: str) -> str:
    """A text as a value of YAML, which takes some words, such as null, and numbers for others."""
    word = re.fullmatch(r"[A-Za-z_.][\w./-]*", text)
    return text if word and text.lower() not in ("true", "false", "null") else json.dumps(
        text, ensure_ascii=False)


def _parsed(text: str) -> dict[str, Any]:
    from ruamel.yaml import YAML

    found: dict[str, Any] = YAML(typ="safe").load(StringIO(text))
    return found
