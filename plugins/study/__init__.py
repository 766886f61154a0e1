"""Studies: parameter studies of one scene, with a table of errors and costs. See
docs/studies.md."""

from sparsemor.plugins.study.run_study import StudyOutcome, run_plan, study

__all__ = ["StudyOutcome", "run_plan", "study"]
