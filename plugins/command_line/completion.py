"""Completion in the shell: names of scenes and plugins, files, keys of `--set`, directories of
runs."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.scene.source import packaged

SCENES = (".yaml", ".yml", ".model")


def scene_names(incomplete: str) -> list[str]:
    """Packaged scenes, scene files, kept models and folders."""
    return _packaged_or_file("scene", SCENES, incomplete)


def study_names(incomplete: str) -> list[str]:
    """Packaged studies, study files and folders."""
    return _packaged_or_file("study", SCENES[:2], incomplete)


def _packaged_or_file(kind: str, endings: tuple[str, ...], incomplete: str) -> list[str]:
    return [*_starting(packaged(Registry(), kind), incomplete),
            *(p for p in _paths(incomplete) if p.endswith(("/", *endings)))]


def stored_runs(incomplete: str) -> list[str]:
    """Directories with the result of a run, and folders that may hold some."""
    return [p.rstrip("/") if OutputDirectory(p).is_result() else p
            for p in _paths(incomplete) if p.endswith("/")]


def plugin_names(incomplete: str) -> list[str]:
    """Kinds and names of plugins."""
    registry = Registry()
    kinds = registry.kinds()
    names = sorted({registry.spelling(p) for kind in kinds for p in registry.names(kind)})
    return _starting([*kinds, *names], incomplete)


def settings(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of the scene that the command line names, and after `=` the plugins of that kind."""
    from sparsemor.core.scene.scene import load

    key, equals, value = incomplete.partition("=")
    if equals:
        names = packaged(Registry(), key.removesuffix(".use").rpartition(".")[2])
        return [f"{key}={name}" for name in _starting(names, value)]
    try:
        scene = load(str(ctx.params.get("scene") or "".join(ctx.args[:1])))
    except (InputError, OSError):
        return []
    return _starting([f"{key}=" for key in _keys(scene.dump())], incomplete)


def _keys(tree: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Dotted keys of values, and of mappings that name a plugin."""
    for name, value in tree.items():
        key = f"{above}{name}"
        if not isinstance(value, Mapping):
            yield key
            continue
        if "use" in value:
            yield key
        yield from _keys(value, f"{key}.")


def _paths(incomplete: str) -> Iterator[str]:
    """Files, and folders with a slash behind them, whose path begins so."""
    above, _, last = incomplete.rpartition("/")
    folder = Path(above or ("/" if incomplete.startswith("/") else "."))
    if folder.is_dir():
        for entry in sorted(os.scandir(folder), key=lambda e: e.name):
            if entry.name.startswith(last) and (last or not entry.name.startswith(".")):
                yield f"{incomplete[: len(incomplete) - len(last)]}{entry.name}" + (
                    "/" if entry.is_dir() else "")


def _starting(names: list[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
