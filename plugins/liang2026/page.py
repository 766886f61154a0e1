"""Pages of a reproduction: one of verdicts and one per scene, as HTML without scripts or network
access."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from sparsemor.core.results.files.listing import write_listed
from sparsemor.plugins.liang2026.paper import BROKEN, GRADES, MISSED, Item, PaperFile
from sparsemor.plugins.liang2026.rules import Operand
from sparsemor.plugins.liang2026.verdicts import Number, Verdict

_COLOURS = {"better": "#d5efdf", "reproduced": "#e3f3d6", "in part": "#fbf0cf",
            MISSED: "#f8dcd6", BROKEN: "#e2e2e2"}
_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1c1c1c; background: #fff;
  max-width: 1120px; margin: 0 auto; padding: 1.5rem 1.2rem 4rem; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0.2rem 0 0.6rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 0.5rem; padding-top: 0.8rem;
  border-top: 1px solid #d8d8d8; }
h2 .grade { float: right; }
nav a { margin-right: 1.1rem; }
a { color: #00558c; }
table { border-collapse: collapse; width: 100%; margin: 0.6rem 0 1rem; font-size: 0.9rem; }
th, td { text-align: left; vertical-align: top; padding: 0.32rem 0.6rem 0.32rem 0;
  border-bottom: 1px solid #e6e6e6; }
th { font-weight: 600; border-bottom: 1px solid #9a9a9a; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
.grade { display: inline-block; padding: 0 0.55em; border-radius: 0.7em; font-size: 0.85rem;
  font-weight: 600; white-space: nowrap; }
code { font: 0.85em/1.4 ui-monospace, monospace; background: #f4f4f4; padding: 0.1em 0.3em;
  border-radius: 3px; overflow-wrap: anywhere; }
.sides { display: grid; grid-template-columns: minmax(15rem, 1fr) minmax(0, 2.2fr); gap: 1.6rem; }
.paper { background: #f7f7f4; border-left: 3px solid #b9b9ac; padding: 0.6rem 0.9rem;
  align-self: start; font-size: 0.93rem; }
.paper h3, .ours h3 { font-size: 0.85rem; margin: 0 0 0.3rem; color: #5b5b5b; font-weight: 600; }
.paper p { margin: 0; }
.ours img { max-width: 100%; height: auto; display: block; margin: 0.4rem 0 1rem; }
img.small { display: block; width: 5.5rem; max-height: 4.5rem; object-fit: cover;
  object-position: top; margin-top: 0.3rem; }
details { margin: 0.5rem 0; font-size: 0.9rem; }
details code { display: block; margin: 0.25rem 0; background: none; padding: 0; }
.note { font-size: 0.93rem; max-width: 75ch; }
@media (max-width: 760px) { .sides { grid-template-columns: 1fr; } }
"""


def write_pages(
    file: PaperFile, verdicts: Sequence[Verdict], commands: Mapping[str, Sequence[str]],
    folder: Path, quick: bool,
) -> list[Path]:
    """Writes index.html with all verdicts and SCENE.html for each scene; returns their paths."""
    items = {i.id: i for i in file.items}
    by_scene = {scene: [v for v in verdicts if items[v.item].scene == scene]
                for scene in file.scenes}
    shown = {scene: found for scene, found in by_scene.items() if found}
    texts = {"index.html": _index(file, items, shown, commands, quick)}
    texts |= {f"{scene}.html": _scene(
        file, items, scene, found, commands, quick, list(shown), folder)
        for scene, found in shown.items()}
    for name, text in texts.items():
        write_listed(folder, name, text.encode())
    return [folder / name for name in texts]


def text_of(value: Operand) -> str:
    """Value as text: four significant digits."""
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else value
    if value == int(value) and abs(value) < 1e6:
        return f"{int(value):d}"
    return f"{value:.4g}" if 1e-3 <= abs(value) < 1e5 else f"{value:.2e}"


def _index(
    file: PaperFile, items: Mapping[str, Item], scenes: Mapping[str, Sequence[Verdict]],
    commands: Mapping[str, Sequence[str]], quick: bool,
) -> str:
    every = [v for found in scenes.values() for v in found]
    parts = [f"<h1>{escape(file.title)}: verdicts</h1>", _opening(file, quick), _navigation(
        file, list(scenes)), f"<p>{_counted(every)}</p>"]
    for scene, found in scenes.items():
        rows = "".join(_row(items[v.item], v, commands[v.item][0]) for v in found)
        parts.append(
            f'<h2><a href="{scene}.html">{escape(file.scenes[scene])}</a></h2><table><tr>'
            "<th>item</th><th>claim</th><th>verdict</th><th>published → here</th><th>command</th>"
            f"</tr>{rows}</table>")
    return _page(f"{file.title}: verdicts", "".join(parts))


def _opening(file: PaperFile, quick: bool) -> str:
    short = ("<strong>Quick run:</strong> shorter time spans and fewer seeds where the whole takes "
             "long; the numbers of these items are not comparable in full. ") if quick else ""
    return (f'<p class="note">{short}Published: {escape(file.source)}. The pictures of the paper '
            "are not available as files: its captions and numbers are given in our own words next "
            "to our pictures. Each verdict is computed from the numbers of this run by the rule "
            "printed with it.</p>")


def _navigation(file: PaperFile, scenes: Sequence[str]) -> str:
    links = "".join(f'<a href="{s}.html">{escape(file.scenes[s])}</a>' for s in scenes)
    return f'<nav><a href="index.html">Verdicts</a>{links}</nav>'


def _counted(verdicts: Sequence[Verdict]) -> str:
    counts = Counter(v.grade for v in verdicts)
    return " ".join(f"{_grade(g)} {counts[g]}" for g in (*GRADES, MISSED, BROKEN) if counts[g])


def _grade(grade: str) -> str:
    return f'<span class="grade" style="background:{_COLOURS[grade]}">{grade}</span>'


def _row(item: Item, verdict: Verdict, command: str) -> str:
    target = f"{item.scene}.html#{item.id}"
    small = "".join(f'<a href="{target}"><img class="small" src="pictures/{escape(p)}" alt="" '
                    f'loading="lazy"></a>' for p in verdict.pictures[:1])
    return (f'<tr><td><a href="{target}">{item.name.replace(" ", "&nbsp;")}</a>{small}'
            f"</td><td>{escape(item.title)}</td><td>{_grade(verdict.grade)}</td>"
            f"<td>{_compared(verdict.numbers)}</td><td><code>{escape(command)}</code></td></tr>")


def _compared(numbers: Sequence[Number]) -> str:
    """The first published numbers, with ours."""
    shown = [n for n in numbers if n.paper is not None][:3] or list(numbers[:2])
    return "<br>".join(
        escape(f"{n.label}: {text_of(n.paper)} → {text_of(n.here)} {n.unit}" if n.paper is not None
               else f"{n.label}: {text_of(n.here)} {n.unit}") for n in shown)


def _scene(
    file: PaperFile, items: Mapping[str, Item], scene: str, verdicts: Sequence[Verdict],
    commands: Mapping[str, Sequence[str]], quick: bool, scenes: Sequence[str], folder: Path,
) -> str:
    title = file.scenes[scene]
    parts = [f"<h1>{escape(title)}</h1>", _opening(file, quick), _navigation(file, scenes),
             f"<p>{_counted(verdicts)}</p>"]
    parts += [_section(items[v.item], v, commands[v.item], folder) for v in verdicts]
    return _page(title, "".join(parts))


def _section(item: Item, verdict: Verdict, commands: Sequence[str], folder: Path) -> str:
    pictures = "".join(
        f'<img src="pictures/{escape(p)}" alt="{escape(f"{item.name}: {item.title}")}" '
        f'width="{_width(folder / "pictures" / p)}" loading="lazy">' for p in verdict.pictures)
    unmet = "" if verdict.met else f'<p class="note">{escape(item.shortfall)}</p>'
    remark = f'<p class="note">{escape(item.remark)}</p>' if item.remark else ""
    faults = "".join(f'<p class="note">Not computed: {escape(f)}</p>' for f in verdict.faults)
    rules = "".join(f"<li>{g}: <code>{escape(' '.join(r.split()))}</code></li>"
                    for g, r in item.verdict.items())
    repeated = "".join(f"<code>{escape(c)}</code>" for c in commands)
    return (
        f'<h2 id="{item.id}">{_grade(verdict.grade)}{item.name}. {escape(item.title)}</h2>'
        f'<div class="sides"><div class="paper"><h3>Published</h3><p>{escape(item.published)}</p>'
        f'</div><div class="ours"><h3>Here</h3>{pictures}{_numbers(verdict.numbers)}{unmet}{remark}'
        f"{faults}<details><summary>Rule of the verdict, commands</summary><ul>{rules}</ul>"
        f"{repeated}</details></div></div>")


def _width(png: Path) -> int:
    """Width of a picture on the page, px: a quarter more than in print, where it has 300 dots per
    inch. The width in dots is stored in bytes 16 to 19 of a PNG file."""
    with png.open("rb") as file:
        dots = int.from_bytes(file.read(20)[16:20], "big")
    return round(1.25 * 96 * dots / 300)


def _numbers(numbers: Sequence[Number]) -> str:
    rows = "".join(
        f'<tr><td>{escape(n.label)} <code>{escape(n.name)}</code></td><td class="number">'
        f'{escape(text_of(n.paper))}</td><td class="number">{escape(text_of(n.here))}</td>'
        f"<td>{escape(n.unit)}</td></tr>" for n in numbers)
    return ("<table><tr><th>quantity</th><th>published</th><th>here</th><th>unit</th></tr>"
            f"{rows}</table>")


def _page(title: str, body: str) -> str:
    return (f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
            f'content="width=device-width"><title>{escape(title)}</title><style>{_STYLE}</style>'
            f"</head><body>{body}</body></html>\n")
