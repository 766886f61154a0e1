"""Studies: one scene under many changes, one table. See docs/studies.md."""

from sparsemor.core.analysis.study.run import StudyOutcome, run_plan, study

__all__ = ["StudyOutcome", "run_plan", "study"]
