"""Studies: one scene under many changes, one table. See docs/studies.md."""

from sparsemor.core.study.conduct import Conducted, conduct, study

__all__ = ["Conducted", "conduct", "study"]
