"""Packaged papers: publications whose figures and tables `sparsemor reproduce` recomputes."""

from pathlib import Path

_HERE = Path(__file__).parent

liang_2026 = _HERE / "liang_2026.yaml"
