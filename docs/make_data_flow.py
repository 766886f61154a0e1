"""Draws data-flow.svg, the picture of concepts.md: `python docs/make_data_flow.py`."""

from collections.abc import Iterator
from pathlib import Path

FILE = Path(__file__).with_name("data-flow.svg")
BOX_WIDTH, BOX_HEIGHT, COLUMN, ROW = 124, 44, 158, 92
BOXES = {  # name: (column, row, lines of text, colour)
    "scene": (0, 0, ("scene.yaml", "checked by key"), "#f3e5ab"),
    "model": (1, 0, ("model", "blocks, terms"), "#d9e8f5"),
    "step": (2, 0, ("step solver", "few unknowns"), "#d9e8f5"),
    "steps": (3, 0, ("each step", "integrator"), "#d9e8f5"),
    "result": (4, 0, ("result", "written as it runs"), "#dcefdc"),
    "training": (0, 1, ("training run", "full order"), "#f0f0f0"),
    "snapshots": (1, 1, ("snapshots", "of each block"), "#f0f0f0"),
    "basis": (2, 1, ("atoms and rows", "basis, sampler"), "#f0f0f0"),
    "charts": (4, 1, ("compare, plot,", "export"), "#dcefdc"),
}
ARROWS = (("scene", "model"), ("model", "step"), ("step", "steps"), ("steps", "result"),
          ("scene", "training"), ("training", "snapshots"), ("snapshots", "basis"),
          ("basis", "step"), ("result", "charts"))


def drawing() -> str:
    """The picture as SVG."""
    width, height = 4 * COLUMN + BOX_WIDTH + 16, ROW + BOX_HEIGHT + 34
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="sans-serif" font-size="13">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0 0L8 4L0 8z" fill="#555"/></marker></defs>',
        f'<rect width="{width}" height="{height}" rx="6" fill="#ffffff"/>',
        f'<rect x="2" y="{ROW - 14}" width="{2 * COLUMN + BOX_WIDTH + 12}" '
        f'height="{BOX_HEIGHT + 44}" rx="6" fill="none" stroke="#999" stroke-dasharray="5 4"/>',
        f'<text x="12" y="{ROW + BOX_HEIGHT + 24}" fill="#555">offline: once, then from the cache'
        '</text>', *map(_arrow, ARROWS), *(line for name in BOXES for line in _box(name)),
        "</svg>", ""])


def _corner(name: str) -> tuple[int, int]:
    column, row, *_ = BOXES[name]
    return 8 + COLUMN * column, 8 + ROW * row


def _box(name: str) -> Iterator[str]:
    (x, y), (_, _, lines, colour) = _corner(name), BOXES[name]
    yield (f'<rect x="{x}" y="{y}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="5" '
           f'fill="{colour}" stroke="#555"/>')
    for i, text in enumerate(lines):
        weight = ' font-weight="bold"' if i == 0 else ""
        yield (f'<text x="{x + BOX_WIDTH // 2}" y="{y + 18 + 17 * i}" text-anchor="middle" '
               f'fill="#222"{weight}>{text}</text>')


def _arrow(ends: tuple[str, str]) -> str:
    (x, y), (u, v) = map(_corner, ends)
    if y == v:
        x, y, u, v = x + BOX_WIDTH, y + BOX_HEIGHT // 2, u, v + BOX_HEIGHT // 2
    else:
        x, u = x + BOX_WIDTH // 2, u + BOX_WIDTH // 2
        y, v = (y + BOX_HEIGHT, v) if v > y else (y, v + BOX_HEIGHT)
    return (f'<path d="M{x} {y}L{u} {v}" stroke="#555" stroke-width="1.5" fill="none" '
            'marker-end="url(#tip)"/>')


if __name__ == "__main__":
    FILE.write_text(drawing(), encoding="utf-8")
