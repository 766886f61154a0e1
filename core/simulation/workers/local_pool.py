"""Worker processes on this machine, for the runs of a study and for training runs; a process that
dies is replaced."""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS",
              "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS")

Payload = Mapping[str, Any]
"""Job as plain data."""


@dataclass(frozen=True, slots=True)
class EndedJob:
    """Result of a job; if its worker died, `answer` is None and `death` the cause. deaths: number
    of workers that died on it since it was submitted."""

    name: str
    answer: dict[str, Any] | None
    death: str = ""
    deaths: int = 0


@dataclass(slots=True, eq=False)
class _Worker:
    process: "subprocess.Popen[str]"
    job: str = ""


class LocalPool:
    """Pool of `workers` processes with one BLAS thread each, which execute the module `program`
    (worker_loop.py); their output is appended to the file `log`. lost: number of them that died."""

    repeats, lost = 3, 0

    def __init__(self, workers: int, log: Path, program: str) -> None:
        self.workers = self.slots = workers
        self._program = program
        self._log: IO[str] = log.open("a", encoding="utf-8")
        self._alive: list[_Worker] = []
        self._lines: queue.Queue[tuple[_Worker, str]] = queue.Queue()

    def submit(self, name: str, job: Payload) -> None:
        """Gives a job to an idle worker, or to a new one."""
        idle = next((w for w in self._alive if not w.job), None) or self._start()
        idle.job = name
        assert idle.process.stdin is not None
        try:
            idle.process.stdin.write(json.dumps({"name": name, "job": job}) + "\n")
            idle.process.stdin.flush()
        except BrokenPipeError:
            pass  # it is dead, which the end of its output shows

    def next(self, timeout: float) -> EndedJob | None:
        """The next job that ends, as done or by the death of its worker; None after `timeout`, s.
        _lines: worker and line of all that is printed, "" at its end; lost: number that died."""
        try:
            worker, line = self._lines.get(timeout=timeout)
        except queue.Empty:
            return None
        if line.endswith("\n"):
            worker.job = ""
            message = json.loads(line)
            return EndedJob(message["name"], message["answer"])
        self._alive.remove(worker)  # "" marks the end of its output: it has died
        code = worker.process.wait()
        self.lost += 1
        return EndedJob(worker.job, None, _cause(code), deaths=1) if worker.job else None

    def close(self) -> None:
        """Ends all workers, whatever they are doing."""
        for worker in self._alive:
            worker.process.kill()  # its answer will not be heard
        for worker in self._alive:
            worker.process.wait()
            for stream in (worker.process.stdin, worker.process.stdout):
                if stream is not None:
                    _close(stream)
        self._alive.clear()
        self._log.close()

    def _start(self) -> _Worker:
        """A new worker process, with a thread that reads its answers."""
        process = subprocess.Popen(
            [sys.executable, "-m", self._program], text=True, encoding="utf-8",
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
            env=os.environ | dict.fromkeys(ONE_THREAD, "1"))
        worker = _Worker(process)
        self._alive.append(worker)
        threading.Thread(target=self._listen, args=(worker,), daemon=True).start()
        return worker

    def _listen(self, worker: _Worker) -> None:
        assert worker.process.stdout is not None
        for line in worker.process.stdout:
            if line.endswith("\n"):  # else it died in the middle of its answer
                self._lines.put((worker, line))
        self._lines.put((worker, ""))


def _close(stream: "IO[str]") -> None:
    try:
        stream.close()
    except BrokenPipeError:
        pass  # what it did not read is lost with it


def _cause(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
