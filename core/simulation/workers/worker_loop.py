"""Loop of a worker process: reads one job per line of its standard input and writes one result per
line.

It exits at the end of its input, and thus with the process that started it.
"""

import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sparsemor.core.results.files.temporary_folders import remove_of

Execute = Callable[[Mapping[str, Any]], dict[str, Any]]
"""Result of a job, as plain data; raises nothing."""


def serve(made: Callable[[], Execute]) -> None:
    """Executes jobs by `made()` until the end of standard input, which is read before `made`, so
    that the process ends with its parent also while it imports."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that gives out jobs
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what plugins print is no answer
    lines: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_listen, args=(lines, os.getppid()), daemon=True).start()
    execute = made()
    while True:
        message = json.loads(lines.get())
        answer = execute(message["job"])
        answers.write(json.dumps({"name": message["name"], "answer": answer}) + "\n")
        answers.flush()


def _listen(lines: "queue.Queue[str]", parent: int) -> None:
    scratch = ""
    for line in sys.stdin:
        scratch = json.loads(line)["job"].get("scratch") or scratch
        lines.put(line)
    if scratch:  # the parent was killed, and cannot remove it
        remove_of(Path(scratch).parent, parent)
    os._exit(0)  # also in the middle of a run: nobody wants its answer
