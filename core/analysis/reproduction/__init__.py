"""Reproduction of a paper: each of its figures and tables recomputed, with the published numbers
and a verdict next to ours. See docs/reproduce.md."""

from sparsemor.core.analysis.reproduction.reproduce import Reproduction, reproduce

__all__ = ["Reproduction", "reproduce"]
