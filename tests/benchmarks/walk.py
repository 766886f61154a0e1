"""Way from the command to the first time step: files entered, calls, depth and returns.

    python tests/benchmarks/walk.py [SCENE] [--full FILE]

Runs `sparsemor run SCENE` (double_pendulum) with an empty cache under `sys.setprofile` and counts
frames of the package: those before the first step of any kind, which is one of the training run,
and up to the first step of the run itself. Imports count: a module that is executed is entered.
A return is a change to a file that was left before, in the sequence of the calls that have not
been made earlier between the same two files.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

STEP = ("core/simulation/time_stepping.py", "__call__")
"""File and function of one time step."""


class Walk:
    """Counts of frames of the package, by a profile function."""

    def __init__(self) -> None:
        self.calls = self.imports = self.depth = self.deepest = 0
        self.files: set[str] = set()
        self.functions: set[tuple[str, int]] = set()
        self.stays: list[str] = []
        self.deepest_stack: list[str] = []
        self.known: dict[str, str] = {}

    def own(self, code: Any) -> str:
        """Path of the file of a frame in the package, "" for others."""
        path = self.known.get(code.co_filename)
        if path is None:
            parts = Path(code.co_filename).parts
            at = next((i for i, p in enumerate(parts) if p in (
                "core", "bodies", "integrators", "reducers", "plugins")
                and is_ours(code.co_filename)), None)
            path = self.known[code.co_filename] = "" if at is None else "/".join(parts[at:])
        return path

    def __call__(self, frame: FrameType, event: str, arg: object) -> None:
        if event not in ("call", "return"):
            return
        path = self.own(frame.f_code)
        if not path:
            return
        if event == "return":
            self.depth -= 1
            return
        self.depth += 1
        self.calls += 1
        name = frame.f_code.co_name
        if name == "<module>":
            self.imports += 1
        else:
            self.functions.add((path, frame.f_code.co_firstlineno))
        self.files.add(path)
        if self.depth > self.deepest:
            self.deepest, self.deepest_stack = self.depth, stack(frame, self)
        caller = frame.f_back
        if name != "<module>" and caller is not None and self.own(caller.f_code) and (
                not self.stays or self.stays[-1] != path):
            self.stays.append(path)
        if (path, name) == STEP:
            self.report("before the first step")
            sys.setprofile(None)
            raise Reached

    def report(self, title: str) -> None:
        print(f"{title}: {len(self.files)} files entered, {self.calls} own calls "
              f"({self.imports} imports), {len(self.functions)} functions, deepest own stack "
              f"{self.deepest}")
        first = list(dict.fromkeys(self.stays))
        print(f"files of called functions: {len(first)}")
        print("deepest stack:", *self.deepest_stack, sep="\n  ")


class Reached(BaseException):
    """The first step."""


def is_ours(name: str) -> bool:
    root = str(Path(__file__).resolve().parents[2])
    return name.startswith(root) or "/sparsemor/" in name


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


if __name__ == "__main__":
    main()
