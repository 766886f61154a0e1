"""Drawing of the folders and their import layers: `python docs/developers/make_layers.py`.

Folders are read from the disk, the order of core's layers from `LAYERS` of the import test.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap

ROOT = Path(__file__).parents[2]
RULES = next((ROOT / "tests" / "laws").rglob("test_imports.py"))
ROLE = {
    "protocols/": "contracts of all plugins, and the values that cross them",
    "registry/": "plugin base class, entry points, slots, hooks",
    "linalg/": "SVD, least squares, factorizations, snapshot matrices",
    "scene/": "YAML file to validated scene, --set, JSON schema",
    "model/": "assembled equations, layout of unknowns, initial state",
    "results/": "result store, reader, error norms",
    "simulation/": "training, cache, time loop, checks before and after a run",
    "cli/": "the program, which finds its commands, and their exit codes",
    "testing/": "law kit: checks of plugins for their authors",
}
"""Folders of core -> their content."""
PLUGINS = {
    "bodies/": "the physics: ",
    "reducers/": "step solvers: ",
    "plugins/": "",
    "integrators/": "time integration: ",
}
"""Other folders -> the words before their parts."""
WIDTH, HIGH, GAP, FULL = 470, 44, 6, 1010
STYLE = 'font-family="sans-serif" font-size="{}" fill="#222"'


def layers() -> list[tuple[str, str]]:
    """(names, role) of core's layers, from the lowest: the flat modules first, then folders."""
    tree = ast.parse(RULES.read_text(encoding="utf-8"))
    order, = (ast.literal_eval(n.value) for n in tree.body if isinstance(n, ast.Assign)
              and ast.unparse(n.targets[0]) == "LAYERS")
    core = ROOT / "core"
    flat = [name for name in order if (core / f"{name}.py").is_file()]
    folders = [f"{name}/" for name in order if (core / name).is_dir()]
    assert set(folders) == set(ROLE), f"a role for each folder of core: {folders}"
    return [(", ".join(flat), "array types, errors, notes, status values"),
            *((name, ROLE[name]) for name in folders)]


def parts(folder: str) -> str:
    """Folders inside a folder, else its modules."""
    here = ROOT / folder
    inside = sorted(p.parent.name for p in here.glob("*/__init__.py"))
    return ", ".join(inside or sorted(p.stem for p in here.glob("[a-z]*.py"))).replace("_", " ")


def box(x: float, y: float, width: float, name: str, role: str, colour: str) -> str:
    lines = wrap(role, int(width / 6.5))
    return "\n".join([
        f'<rect x="{x}" y="{y}" width="{width}" height="{HIGH + 14 * (len(lines) - 1)}" rx="5" '
        f'fill="{colour}" stroke="#555"/>',
        f'<text x="{x + 10}" y="{y + 18}" font-weight="bold" {STYLE.format(14)}>{name}</text>',
        *(f'<text x="{x + 10}" y="{y + 35 + 14 * i}" {STYLE.format(11)}>{line}</text>'
          for i, line in enumerate(lines))])


def drawing() -> str:
    """The picture as SVG: core's layers on the left, the plugins that import them on the right."""
    return "\n".join([*_lines(layers()), ""])


def _lines(core: list[tuple[str, str]]) -> Iterator[str]:
    top, step = 40, HIGH + GAP
    tall = top + len(core) * step + 34
    yield (f'<svg xmlns="http://www.w3.org/2000/svg" width="{FULL}" height="{tall}" '
           f'viewBox="0 0 {FULL} {tall}">')
    yield f'<rect width="{FULL}" height="{tall}" fill="white"/>'
    for x, words in ((10, "core/: each layer imports those below it"),
                     (WIDTH + 60, "plugins: each folder imports core and itself")):
        yield f'<text x="{x}" y="26" {STYLE.format(16)}>{words}</text>'
    for i, (name, role) in enumerate(reversed(core)):
        yield box(10, top + i * step, WIDTH - 20, name, role, "#dbe9f6")
    for i, (name, words) in enumerate(PLUGINS.items()):
        yield box(WIDTH + 60, top + (2 * i + 1) * step, FULL - WIDTH - 70, name,
                  words + parts(name), "#fde5c8")
    x, low = WIDTH + 14, top + 8 * step + HIGH / 2
    yield f'<path d="M {WIDTH + 56} {low} H {x}" stroke="#555" stroke-width="2"/>'
    yield (f'<path d="M {x + 10} {low - 6} L {x - 2} {low} L {x + 10} {low + 6} Z" '
           'fill="#555"/>')
    yield (f'<text x="10" y="{tall - 12}" {STYLE.format(12)}>Plugins are found by entry points: '
           'core never imports them. tests/laws/project/test_imports.py checks these rules.</text>')
    yield "</svg>"


if __name__ == "__main__":
    Path(__file__).with_name("layers.svg").write_text(drawing(), encoding="utf-8")
