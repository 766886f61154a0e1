"""The architecture page: its twenty questions have answers that exist, and its picture is drawn."""

import re
import runpy
from pathlib import Path

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "docs" / "developers"
PAGE = (FOLDER / "architecture.md").read_text(encoding="utf-8")
TARGET = re.compile(r"`([\w/]+\.py)(?::([A-Za-z_][\w.]*))?`")


def test_twenty_questions_have_an_answer_each() -> None:
    rows = re.findall(r"(?m)^\| ([^|]+\?) \| (.+) \|$", PAGE)
    assert len(rows) >= 20 and all(TARGET.search(answer) for _, answer in rows)


def test_the_picture_shows_the_folders() -> None:
    made = runpy.run_path(str(FOLDER / "make_layers.py"))
    drawn = made["drawing"]()
    assert drawn == (FOLDER / "layers.svg").read_text(encoding="utf-8"), (
        "run: python docs/developers/make_layers.py")
    folders = {f"{p.parent.name}/" for p in ROOT.glob("*/__init__.py")} - {"core/"}
    assert folders == set(made["PLUGINS"])
    assert all(f">{name}<" in drawn for name in (*made["ROLE"], *folders))
