"""Follows docs/first-run.md word by word in a fresh clone: `python tests/docs/follow_first_run.py`.

Every console block of the page is run by one shell, in the order of the page, and what it promises
to print is compared; the chart of the comparison must be there at the end.
"""

import os
import re
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
CHART = "runs/double_pendulum-compare/work_precision.png"
LIMIT = 600.0
"""Longest time of all of it, s."""


def follow(clone: Path, home: Path) -> float:
    """Seconds until the chart is there. Raises AssertionError where the page is wrong."""
    page = (clone / "docs" / "first-run.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?ms)^```console[^\n]*\n(.*?)^```", page)
    lines = [line for block in blocks for line in block.splitlines()]
    commands = [line[2:] for line in lines if line.startswith("$ ")]
    promised = [" ".join(line[5:].split()) for line in lines if line.startswith("# -> ")]
    assert commands and promised and len(commands) + len(promised) == len(lines), lines
    kept = ("PATH", "LANG", "PIP_INDEX_URL", "PIP_CONFIG_FILE", "PIP_CACHE_DIR")
    start = time.monotonic()
    done = subprocess.run(
        ["bash", "-e", "-c", "\n".join(commands)], cwd=clone, capture_output=True, text=True,
        env={"HOME": str(home), **{k: os.environ[k] for k in kept if k in os.environ}},
        check=False, timeout=LIMIT)
    taken = time.monotonic() - start
    assert done.returncode == 0, done.stdout + done.stderr
    printed = " ".join((done.stdout + done.stderr).split())
    for text in promised:
        assert text in printed, f"not printed: {text}\n{done.stdout}"
    assert (clone / CHART).stat().st_size > 10_000
    return taken


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        clone = Path(folder, "sparsemor")
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        seconds = follow(clone, Path(folder))
        print(f"first run, from an empty environment to its chart: {seconds:.0f} s")
