"""Pages of a reproduction: one of verdicts and one per scene, as HTML without scripts or network
access."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from sparsemor.plugins.liang2026.item_functions import Value
from sparsemor.plugins.liang2026.paper import BROKEN, MISSED, PaperFile, PaperItem
from sparsemor.plugins.liang2026.verdicts import Number, Verdict
from sparsemor.plugins.publishing.listed_files import write_listed

_COLOURS = {"better": "#d5efdf", "reproduced": "#e3f3d6", "in part": "#fbf0cf",
            MISSED: "#f8dcd6", BROKEN: "#e2e2e2"}
_STYLE = Path(__file__).with_name("page.css")
Commands = Mapping[str, Sequence[str]]
"""Item -> commands that recompute it."""


def write_pages(
    file: PaperFile, verdicts: Sequence[Verdict], commands: Commands, folder: Path, quick: bool
) -> list[Path]:
    """Writes index.html with all verdicts and SCENE.html for each scene; returns their paths."""
    items = {i.id: i for i in file.items}
    by_scene = {scene: [(items[v.item], v) for v in verdicts if items[v.item].scene == scene]
                for scene in file.scenes}
    shown = {scene: found for scene, found in by_scene.items() if found}
    links = "".join(f'<a href="{s}.html">{escape(file.scenes[s])}</a>' for s in shown)
    opening = _opening(file, quick) + f'<nav><a href="index.html">Verdicts</a>{links}</nav>'
    tables = [f'<h2><a href="{s}.html">{escape(file.scenes[s])}</a></h2><table><tr>'
              "<th>item</th><th>claim</th><th>verdict</th><th>published → here</th><th>command"
              f"</th></tr>{''.join(_row(i, v, commands[i.id][0]) for i, v in found)}</table>"
              for s, found in shown.items()]
    texts = {"index.html": _page(f"{file.title}: verdicts", opening, verdicts, tables)}
    for s, found in shown.items():
        texts[f"{s}.html"] = _page(file.scenes[s], opening, [v for _, v in found], [
            _section(i, v, commands[i.id], folder) for i, v in found])
    for name, text in texts.items():
        write_listed(folder, name, text.encode())
    return [folder / name for name in texts]


def text_of(value: Value) -> str:
    """Value as text: four significant digits."""
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else value
    if value == int(value) and abs(value) < 1e6:
        return f"{int(value):d}"
    return f"{value:.4g}" if 1e-3 <= abs(value) < 1e5 else f"{value:.2e}"


def _page(title: str, opening: str, verdicts: Sequence[Verdict], parts: Sequence[str]) -> str:
    counts = Counter(v.grade for v in verdicts)
    counted = " ".join(f"{_grade(g)} {counts[g]}" for g in _COLOURS if counts[g])
    return ('<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
            f'content="width=device-width"><title>{escape(title)}</title><style>\n'
            f"{_STYLE.read_text(encoding='utf-8')}</style></head><body><h1>{escape(title)}</h1>"
            f"{opening}<p>{counted}</p>{''.join(parts)}</body></html>\n")


def _opening(file: PaperFile, quick: bool) -> str:
    short = ("<strong>Quick run:</strong> shorter time spans and fewer seeds where the whole takes "
             "long; the numbers of these items are not comparable in full. ") if quick else ""
    return (f'<p class="note">{short}Published: {escape(file.source)}. The pictures of the paper '
            "are not available as files: its captions and numbers are given in our own words next "
            "to our pictures. Each verdict is computed from the numbers of this run by the rule "
            "printed with it.</p>")


def _grade(grade: str) -> str:
    return f'<span class="grade" style="background:{_COLOURS[grade]}">{grade}</span>'


def _row(item: PaperItem, verdict: Verdict, command: str) -> str:
    target = f"{item.scene}.html#{item.id}"
    small = "".join(f'<a href="{target}"><img class="small" src="pictures/{escape(p)}" alt="" '
                    f'loading="lazy"></a>' for p in verdict.pictures[:1])
    return (f'<tr><td><a href="{target}">{item.name.replace(" ", "&nbsp;")}</a>{small}'
            f"</td><td>{escape(item.title)}</td><td>{_grade(verdict.grade)}</td>"
            f"<td>{_compared(verdict.numbers)}</td><td><code>{escape(command)}</code></td></tr>")


def _compared(numbers: Sequence[Number]) -> str:
    """The first published numbers, with ours."""
    shown = [n for n in numbers if n.paper is not None][:3] or numbers[:2]
    return "<br>".join(
        escape(f"{n.label}: {f'{text_of(n.paper)} → ' if n.paper is not None else ''}"
               f"{text_of(n.here)} {n.unit}") for n in shown)


def _section(item: PaperItem, verdict: Verdict, commands: Sequence[str], folder: Path) -> str:
    """HTML of one item: the published result next to ours, with the rule of the verdict and the
    commands."""
    pictures = "".join(
        f'<img src="pictures/{escape(p)}" alt="{escape(f"{item.name}: {item.title}")}" '
        f'width="{_width(folder / "pictures" / p)}" loading="lazy">' for p in verdict.pictures)
    notes = ["" if verdict.met else item.shortfall, item.remark,
             *(f"Not computed: {fault}" for fault in verdict.faults)]
    noted = "".join(f'<p class="note">{escape(note)}</p>' for note in notes if note)
    rules = "".join(f"<li>{g}: <code>{escape(' '.join(r.split()))}</code></li>"
                    for g, r in item.verdict.items())
    repeated = "".join(f"<code>{escape(c)}</code>" for c in commands)
    rows = "".join(
        f'<tr><td>{escape(n.label)} <code>{escape(n.name)}</code></td><td class="number">'
        f'{escape(text_of(n.paper))}</td><td class="number">{escape(text_of(n.here))}</td>'
        f"<td>{escape(n.unit)}</td></tr>" for n in verdict.numbers)
    return (
        f'<h2 id="{item.id}">{_grade(verdict.grade)}{item.name}. {escape(item.title)}</h2>'
        f'<div class="sides"><div class="paper"><h3>Published</h3><p>{escape(item.published)}</p>'
        f'</div><div class="ours"><h3>Here</h3>{pictures}<table><tr><th>quantity</th><th>published'
        f"</th><th>here</th><th>unit</th></tr>{rows}</table>{noted}<details><summary>Rule of the "
        f"verdict, commands</summary><ul>{rules}</ul>{repeated}</details></div></div>")


def _width(png: Path) -> int:
    """Width of a picture on the page, px: a quarter more than in print, where it has 300 dots per
    inch. The width in dots is stored in bytes 16 to 19 of a PNG file."""
    with png.open("rb") as file:
        dots = int.from_bytes(file.read(20)[16:20], "big")
    return round(1.25 * 96 * dots / 300)
