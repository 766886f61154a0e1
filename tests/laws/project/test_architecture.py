"""The architecture page: its twenty questions have answers that exist, and its picture is drawn."""

import ast
import re
import runpy
from pathlib import Path

from source_trees import tree_of

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "docs" / "developers"
PAGE = (FOLDER / "architecture.md").read_text(encoding="utf-8")
TARGET = re.compile(r"`([\w/]+\.py)(?::([A-Za-z_][\w.]*))?`")


def defined(path: Path) -> set[str]:
    """Classes, functions and methods of a file, methods dotted."""
    found = set()
    for node in tree_of(path).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{m.name}" for m in node.body if isinstance(m, ast.FunctionDef)}
    return found


def absent(page: str) -> list[str]:
    """Files, and names in them, that a page mentions and that are not there."""
    return [f"{file}:{name}" for file, name in TARGET.findall(page)
            if not (ROOT / file).is_file() or name and name not in defined(ROOT / file)]


def test_every_file_and_name_exists() -> None:
    assert len(TARGET.findall(PAGE)) > 60
    assert absent(PAGE) == []


def test_twenty_questions_have_an_answer_each() -> None:
    rows = re.findall(r"(?m)^\| ([^|]+\?) \| (.+) \|$", PAGE)
    assert len(rows) >= 20 and all(TARGET.search(answer) for _, answer in rows)


def test_a_wrong_answer_is_found() -> None:
    wrong = "`core/no_such.py`, `core/status.py:Nothing`, `core/status.py:Status`"
    assert absent(wrong) == ["core/no_such.py:", "core/status.py:Nothing"]


def test_the_picture_shows_the_folders() -> None:
    made = runpy.run_path(str(FOLDER / "make_layers.py"))
    drawn = made["drawing"]()
    assert drawn == (FOLDER / "layers.svg").read_text(encoding="utf-8"), (
        "run: python docs/developers/make_layers.py")
    folders = {f"{p.parent.name}/" for p in ROOT.glob("*/__init__.py")} - {"core/"}
    assert folders == set(made["PLUGINS"])
    assert all(f">{name}<" in drawn for name in (*made["ROLE"], *folders))
