"""Stored runs and studies of a reproduction, opened when they are needed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sparsemor.core.analysis.study.journal import Journal, is_study
from sparsemor.core.analysis.study.plan import Plan
from sparsemor.core.errors import InputError
from sparsemor.core.results.error_norms import Errors, measure_errors
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.plugins.liang2026.jobs import SPLIT, folder_of, plan_of
from sparsemor.plugins.liang2026.paper import PaperFile


@dataclass(frozen=True, slots=True, eq=False)
class StoredResults:
    """Runs and studies of a paper file in the folder of a reproduction; failed: name -> reason why
    a run or study could not be made."""

    file: PaperFile
    folder: Path
    quick: bool
    failed: Mapping[str, str] = field(default_factory=dict)
    _runs: dict[str, RunResult] = field(default_factory=dict)
    _errors: dict[tuple[str, str], Errors] = field(default_factory=dict)
    _plans: dict[str, Plan] = field(default_factory=dict)

    def run(self, name: str) -> RunResult:
        """Result of a run. Raises InputError if there is none."""
        self._refuse(name)
        if name not in self._runs:
            self._runs[name] = open_result(folder_of(self.folder, name, True))
        return self._runs[name]

    def errors(self, reference: str, run: str) -> Errors:
        """Errors of a run relative to a reference run, measured once."""
        key = reference, run
        if key not in self._errors:
            self._errors[key] = measure_errors(self.run(reference), self.run(run))
        return self._errors[key]

    def plan(self, study: str) -> Plan:
        """Plan of a study."""
        if study not in self._plans:
            folder = folder_of(self.folder, study, False)
            self._plans[study] = plan_of(
                self.file.studies[study], self.file.rows_read(study), self.quick,
                folder.with_name(f"{study}.yaml"))
        return self._plans[study]

    def rows(self, study: str) -> Sequence[Mapping[str, Any]]:
        """Rows of a study's table. Raises InputError if there are none."""
        self._refuse(study)
        folder = folder_of(self.folder, study, False)
        if not is_study(folder):
            raise InputError(f"there is no study in {folder}")
        return Journal(folder, self.plan(study).columns).rows()

    def split(self, run: str) -> Mapping[str, float]:
        """Shares of the computing time of a run. Raises InputError if it was not profiled."""
        self._refuse(run)
        path = folder_of(self.folder, run, True) / SPLIT
        if not path.is_file():
            raise InputError(f"run {run} was not profiled")
        found: Mapping[str, float] = json.loads(path.read_text(encoding="utf-8"))
        return found

    def _refuse(self, name: str) -> None:
        if name in self.failed:
            raise InputError(f"{name}: {self.failed[name]}")
