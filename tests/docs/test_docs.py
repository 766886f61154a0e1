"""Every fenced block of the documentation that is marked `run` runs and says what it promises.

Conventions, in the info string of a block of docs/**/*.md or README.md:

* `yaml file NAME`, `python file NAME`: written under that name into the page's own folder;
* `python run`: executed there. `expression  # -> value` holds to the digits that are shown;
* `console run`: each `$ command` succeeds, and each `# -> text` after it stands in what it
  prints (blanks count as one). `$ ! command` fails, and its text stands in what it complains.
  `sparsemor` runs in the process of the test: most of what a short command takes is to start.

The blocks of a page share the folder and the names, from top to bottom.
"""

import ast
import contextlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from sparsemor.core.cli import app

pytestmark = pytest.mark.full

ROOT = Path(__file__).parents[2]
LONG = ("kept-models", "machines", "methods", "pictures", "status-and-failures", "studies")
"""Pages that take a quarter of a minute and more each."""
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Block:
    """One fenced block: words of its info string, text, and first line number in the page."""

    words: tuple[str, ...]
    text: str
    line: int


def blocks(page: str) -> Iterator[Block]:
    for m in _FENCE.finditer(page):
        yield Block(tuple(m[1].split()), m[2], page.count("\n", 0, m.start(2)) + 1)


def runnable(path: Path) -> list[Block]:
    found = blocks(path.read_text(encoding="utf-8"))
    return [b for b in found if b.words[1:2] in (("run",), ("file",))]


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Offline products that all pages share: they train on the same short runs."""
    return tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize("path", [
    pytest.param(p, id=str(p.relative_to(ROOT)), marks=[pytest.mark.slow] * (p.stem in LONG))
    for p in PAGES if runnable(p)])
def test_page(
    path: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(cache))
    names: dict[str, Any] = {"__name__": "__page__"}
    before = set(sys.modules)
    try:
        for block in runnable(path):
            _do(block, path, tmp_path, names)
    finally:
        for name in set(sys.modules) - before:
            if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == tmp_path:
                del sys.modules[name]


def _do(block: Block, page: Path, folder: Path, names: dict[str, Any]) -> None:
    match block.words:
        case _, "file", name:
            (folder / name).write_text(block.text, encoding="utf-8")
        case "python", "run":
            run_python(block, page, names)
        case "console", "run":
            run_console(block, page, folder)
        case _:
            pytest.fail(f"{page.name}:{block.line}: {' '.join(block.words)} is no convention")


def run_python(block: Block, page: Path, names: dict[str, Any]) -> None:
    lines = block.text.splitlines()
    for statement in ast.parse(block.text).body:
        end = statement.end_lineno
        assert end is not None
        where = f"{page.name}:{block.line + end - 1}"
        promised = lines[end - 1].partition("# -> ")[2].strip()
        module = ast.Module([statement], [])
        if not promised:
            exec(compile(module, where, "exec"), names)
            continue
        assert isinstance(statement, ast.Expr), f"{where}: a value needs an expression"
        value = eval(compile(ast.Expression(statement.value), where, "eval"), names)
        assert agrees(str(value), promised), f"{where}: {value}, promised {promised}"


def in_process(words: list[str], folder: Path) -> tuple[int, str]:
    """Exit code of `sparsemor` in the folder, and what it prints and complains."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, words, prog_name="sparsemor")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.stdout + done.stderr


def in_python(words: list[str], folder: Path) -> tuple[int, str]:
    """The same of `python`."""
    done = subprocess.run([sys.executable, *words], cwd=folder, text=True, capture_output=True,
                          check=False, timeout=300)
    return done.returncode, done.stdout + done.stderr


RUNS = {"sparsemor": in_process, "python": in_python}
"""Programs that a page may run."""


def run_console(block: Block, page: Path, folder: Path) -> None:
    printed = ""
    for number, line in enumerate(block.text.splitlines(), block.line):
        where = f"{page.name}:{number}"
        if line.startswith("$ "):
            fails = line.startswith("$ ! ")
            words = shlex.split(line[4 if fails else 2:], comments=True)
            assert words[0] in RUNS, f"{where}: only {' and '.join(RUNS)}"
            code, text = RUNS[words[0]](words[1:], folder)
            assert (code != 0) == fails, f"{where}: {text}"
            printed = " ".join(text.split())
        elif line.startswith("# -> "):
            text = " ".join(line.removeprefix("# -> ").split())
            assert text in printed, f"{where}: not printed: {text}\nprinted: {printed}"


def agrees(value: str, promised: str) -> bool:
    """The same text, and numbers that agree to the last digit shown (one unit of it)."""
    if _NUMBER.sub("#", " ".join(value.split())) != _NUMBER.sub("#", " ".join(promised.split())):
        return False
    return all(abs(float(v) - float(p)) <= last_digit(p)
               for v, p in zip(_NUMBER.findall(value), _NUMBER.findall(promised), strict=True))


def last_digit(number: str) -> float:
    """One unit of the last digit shown; 0 for whole numbers."""
    mantissa, _, exponent = number.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0


@pytest.mark.parametrize(("value", "promised", "same"), [
    ("0.92812", "0.928", True), ("0.9312", "0.928", False), ("-153.0812", "-153.08", True),
    ("1.5e-10", "1.6e-10", True), ("1.5e-10", "1.8e-10", False), ("29", "30", False),
    ("(3, 0.5)", "(3, 0.50)", True), ("done", "diverged", False), ("nan", "1.0", False),
])
def test_a_promise_can_be_broken(value: str, promised: str, same: bool) -> None:
    assert agrees(value, promised) is same


def test_a_wrong_page_fails(tmp_path: Path) -> None:
    bad = [("python run", "x = 2.0\nx * 2  # -> 5.0\n"), ("console run", "$ sparsemor nothing\n"),
           ("console run", "$ sparsemor plugins sampler\n# -> no such line\n")]
    for info, text in bad:
        (block,) = blocks(f"```{info}\n{text}```\n")
        with pytest.raises(AssertionError):
            _do(block, tmp_path / "page.md", tmp_path, {})


@pytest.mark.parametrize(
    "script", ["make_reference.py", "make_contracts.py", "make_commands.py"])
def test_generated_pages_are_up_to_date(script: str) -> None:
    made = subprocess.run(
        [sys.executable, "-c", "import json, runpy, sys; "
         "print(json.dumps(runpy.run_path(sys.argv[1])['pages']()))",
         str(ROOT / "docs" / script)],
        capture_output=True, check=True, encoding="utf-8").stdout
    for name, text in json.loads(made).items():
        committed = (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
        assert text == committed, f"run: python docs/{script}"
