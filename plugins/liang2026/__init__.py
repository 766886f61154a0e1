"""Liang et al. (2026) reproduced: its runs, figures and tables, and the command that recomputes
those of this and other papers, with the published numbers and a verdict next to ours. See
docs/validation/reproduce.md."""

from pathlib import Path

PAPER = "liang_2026"
"""Paper that `sparsemor reproduce` recomputes where none is named."""
liang_2026 = Path(__file__).with_name("liang_2026.yaml")
