"""The notebooks of docs/notebooks, in a kernel: each ends without an error, its figures are
pictures without magic commands, and a call has at most one output that shows its progress."""

import ast
import re
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
SOURCES = sorted(FOLDER.glob("*.py"))
FIGURES = {"first_run": 2, "own_mesh": 1, "study": 1, "kept_model": 1, "tables": 0}
"""Notebook -> number of its charts."""
NOTHING: dict[str, Any] = {}


def notebook(source: str) -> Any:
    """A script whose cells begin with `# %%`, comments below it as text, as a notebook."""
    title = ast.get_docstring(ast.parse(source)) or ""
    cells = [nbformat.v4.new_markdown_cell(title)]
    for cell in source.split("\n# %%\n")[1:]:
        text = re.match(r"(?:#.*\n)*", cell)
        assert text is not None
        if text[0]:
            cells.append(nbformat.v4.new_markdown_cell(re.sub("^# ?", "", text[0], flags=re.M)))
        cells.append(nbformat.v4.new_code_cell(cell[text.end():].strip()))
    return nbformat.v4.new_notebook(cells=cells)


def executed(nb: Any, folder: Path, fails: bool = False) -> list[Any]:
    """Code cells of a notebook, executed in a folder by the kernel of this interpreter."""
    client = nbclient.NotebookClient(
        nb, timeout=600, kernel_name="python3", allow_errors=fails,
        resources={"metadata": {"path": str(folder)}})
    client.execute()
    return [cell for cell in nb.cells if cell.cell_type == "code"]


def test_there_are_five_without_magic_commands() -> None:
    assert {p.stem for p in SOURCES} == FIGURES.keys()
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        ast.parse(text)  # no `%` and no `!`
        assert "pyplot" not in text and len(text.splitlines()) < 80
        assert notebook(text).cells[1].cell_type in ("markdown", "code")


@pytest.mark.full
@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.stem)
def test_notebook(path: Path, here: Path) -> None:
    cells = executed(notebook(path.read_text(encoding="utf-8")), here)
    figures = 0
    for cell in cells:
        shown = [o.get("data", NOTHING) for o in cell.outputs]
        assert not [o for o in cell.outputs if o.output_type == "stream" and o.name == "stderr"]
        assert sum(o.output_type == "display_data" for o in cell.outputs) <= 1, cell.source
        assert sum("Figure" in d.get("text/plain", "") for d in shown) == sum(
            "image/png" in d for d in shown)
        figures += sum("image/png" in d for d in shown)
        if "progress=True" in cell.source:
            assert re.search(r" steps$|done", shown[0]["text/plain"])
    assert figures == FIGURES[path.stem]


@pytest.mark.full
def test_bad_input_is_one_message_in_a_notebook(here: Path) -> None:
    cells = executed(notebook("\n# %%\n".join((
        '"""Faults"""', "from sparsemor import load, simulate",
        "load('doubel_pendulum')", "load({'bodies': {'a': {'use': 'rigid', 'mass': -1.0}}})",
        "1 / 0"))), here, fails=True)
    first, second, own = (cell.outputs[0] for cell in cells[1:])
    for output, part in ((first, "double_pendulum"), (second, "greater than")):
        (text,) = output.traceback
        assert part in text and "File" not in text and len(text.splitlines()) < 4
    assert "ZeroDivisionError" in "\n".join(own.traceback)
