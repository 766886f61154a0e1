"""Drawing of the folders and their import layers: `python docs/developers/make_layers.py`."""

from pathlib import Path

CORE = ("arrays, errors, notes, status", "protocols/", "registry/", "linalg/", "scene/", "model/",
        "results/", "simulation/", "analysis/", "cli/")
"""Layers of core from bottom to top: each imports those below it only."""
ROLE = {
    "arrays, errors, notes, status": "array types, InputError, Note, Status",
    "protocols/": "contracts of all plugins, and the values that cross them",
    "registry/": "plugin base class, entry points, slots, hooks",
    "linalg/": "SVD, least squares, factorizations, snapshot matrices",
    "scene/": "YAML file to validated scene, --set, JSON schema",
    "model/": "assembled equations, layout of unknowns, initial state",
    "results/": "result store, reader, error norms, export",
    "simulation/": "training, cache, time loop, checks before and after a run",
    "analysis/": "compare, study, stability survey, charts",
    "cli/": "commands",
}
PLUGINS = (("bodies/", "meshes, finite elements, frames, joints, loads, contact"),
           ("reducers/", "full order, projection, sparse; the step of each"),
           ("plugins/", "bases, samplers, solvers, preconditioners, scenes, studies"),
           ("integrators/", "BDF1, BDF2, generalized-alpha"))
WIDTH, HIGH, GAP, FULL = 470, 44, 6, 960
STYLE = 'font-family="sans-serif" font-size="{}" fill="#222"'


def box(x: float, y: float, width: float, name: str, role: str, colour: str) -> str:
    return "\n".join([
        f'<rect x="{x}" y="{y}" width="{width}" height="{HIGH}" rx="5" fill="{colour}" '
        'stroke="#555"/>',
        f'<text x="{x + 10}" y="{y + 18}" font-weight="bold" {STYLE.format(14)}>{name}</text>',
        f'<text x="{x + 10}" y="{y + 35}" {STYLE.format(12)}>{role}</text>'])


def drawing() -> str:
    top, step = 40, HIGH + GAP
    tall = top + len(CORE) * step + 34
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{FULL}" height="{tall}" '
             f'viewBox="0 0 {FULL} {tall}">',
             f'<rect width="{FULL}" height="{tall}" fill="white"/>',
             f'<text x="10" y="26" {STYLE.format(16)}>core/: each layer imports those below it'
             '</text>',
             f'<text x="{WIDTH + 60}" y="26" {STYLE.format(16)}>plugins: import core and '
             'themselves</text>']
    for i, name in enumerate(reversed(CORE)):
        lines.append(box(10, top + i * step, WIDTH - 20, name, ROLE[name], "#dbe9f6"))
    for i, (name, role) in enumerate(PLUGINS):
        lines.append(box(WIDTH + 60, top + (2 * i + 1) * step, WIDTH - 50, name, role, "#fde5c8"))
    x, low = WIDTH + 14, top + 7 * step + HIGH / 2
    lines += [f'<path d="M {WIDTH + 56} {low} H {x}" stroke="#555" stroke-width="2"/>',
              f'<path d="M {x + 10} {low - 6} L {x - 2} {low} L {x + 10} {low + 6} Z" '
              'fill="#555"/>',
              f'<text x="10" y="{tall - 12}" {STYLE.format(12)}>Plugins are found by entry points: '
              'core never imports them. tests/laws/test_imports.py holds these rules.</text>',
              "</svg>", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    Path(__file__).with_name("layers.svg").write_text(drawing(), encoding="utf-8")
