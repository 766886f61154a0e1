"""Way from the command to the first time step: files entered, calls, depth and returns.

    python tests/benchmarks/walk.py [SCENE]

Runs `sparsemor run SCENE` (double_pendulum) with an empty cache under `sys.setprofile` up to the
first step of any kind, which is one of the training run, and counts frames of the package. A module
that is imported is entered, too; files of which a function was called are counted separately.

The walk begins at the function of the command and follows each function once, where it is called
first, as a reader does: successive functions of one file are a stay, and a stay in a file that was
left before is a return. The checks at the boundary of plugins (core/registry/boundary.py) and what
runs on import are not followed. Counted are all functions up to the first step, and those of the
main line: functions that have not ended when the step begins, and what they call themselves.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("core", "bodies", "integrators", "reducers", "plugins")
COMMAND = ("plugins/commands/run.py", "run")
"""File and function of the command."""
BOUNDARY = "core/registry/boundary.py"
PARTS = ("<genexpr>", "<lambda>", "<listcomp>", "<dictcomp>", "<setcomp>")
"""Frames that are parts of a function."""
STEP = ("core/simulation/time_stepping.py", "__call__")
"""File and function of one time step."""


class Walk:
    """Counts of frames of the package, by a profile function."""

    def __init__(self) -> None:
        self.calls = self.imports = self.depth = self.deepest = 0
        self.files: set[str] = set()
        self.called: set[str] = set()
        self.functions: set[tuple[str, int]] = set()
        self.stays: list[str] = []
        self.made: list[tuple[str, str, int]] = []
        self.open: list[int] = []
        self.deepest_stack: list[str] = []
        self.known: dict[str, str] = {}
        self.importing = 0
        self.begun = False

    def own(self, code: Any) -> str:
        """Path of the file of a frame in the package, "" for others."""
        path = self.known.get(code.co_filename)
        if path is None:
            parts = Path(code.co_filename).parts
            ours = code.co_filename.startswith(str(ROOT)) or "sparsemor" in parts
            at = [i for i, part in enumerate(parts) if part in FOLDERS] if ours else []
            path = self.known[code.co_filename] = "/".join(parts[at[0]:]) if at else ""
        return path

    def __call__(self, frame: FrameType, event: str, arg: object) -> None:
        path = self.own(frame.f_code) if event in ("call", "return") else ""
        if not path:
            return
        name = frame.f_code.co_name
        if event == "return":
            self.depth -= 1
            self.importing -= name == "<module>"
            if self.open:
                self.open.pop()
            return
        self.depth += 1
        self.calls += 1
        self.files.add(path)
        if name == "<module>":
            self.imports += 1
            self.importing += 1
        else:
            self.called.add(path)
        if self.depth > self.deepest:
            self.deepest, self.deepest_stack = self.depth, stack(frame, self)
        self.begun = self.begun or (path, name) == COMMAND
        if self.begun:
            caller = self.open[-1] if self.open else -1
            if name not in PARTS:
                self.made.append((path, name, caller))
            self.open.append(caller if name in PARTS else len(self.made) - 1)
        function = path, frame.f_code.co_firstlineno
        if self.begun and not self.importing and path != BOUNDARY and (
                function not in self.functions):
            self.functions.add(function)
            self.stays.append(path)
        if (path, name) == STEP:
            sys.setprofile(None)
            raise Reached

    def main_line(self) -> list[str]:
        """Files of the functions that have not ended, and of those that they call, in order."""
        line, seen, files = {*self.open}, set[tuple[str, str]](), []
        for i, (path, name, caller) in enumerate(self.made):
            if i in line or caller in line and name != "<module>" and (path, name) not in seen:
                seen.add((path, name))
                files.append(path)
        return files

    def report(self) -> None:
        print(f"main line: {stays(self.main_line())}")
        print(f"before the first step: {stays(self.stays)}")
        print(f"files entered {len(self.files)} (a function called in {len(self.called)}), own "
              f"calls {self.calls} ({self.imports} imports), deepest own stack {self.deepest}:")
        print(*(f"  {line}" for line in self.deepest_stack), sep="\n")


def stays(files: list[str]) -> str:
    """Stays in files by successive functions, and returns among them."""
    found = [f for f, before in zip(files, ["", *files], strict=False) if f != before]
    return (f"{len(found)} stays in {len({*found})} files, {len(found) - len({*found})} returns "
            "to a file already left")


class Reached(BaseException):
    """The first step."""


def stack(frame: FrameType | None, walk: Walk) -> list[str]:
    found = []
    while frame is not None:
        if path := walk.own(frame.f_code):
            found.append(f"{path}:{frame.f_code.co_qualname}")
        frame = frame.f_back
    return found[::-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="double_pendulum")
    scene = parser.parse_args().scene
    walk = Walk()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SPARSEMOR_CACHE"] = str(Path(folder, "cache"))
        sys.argv = ["sparsemor", "run", scene, "--out", str(Path(folder, "out"))]
        sys.setprofile(walk)
        try:
            from sparsemor.core.cli import main as command
            command()
        except Reached:
            pass
        finally:
            sys.setprofile(None)
    walk.report()


if __name__ == "__main__":
    main()
