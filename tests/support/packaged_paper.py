"""The packaged paper file, which takes half a second to read: read once in a process."""

from functools import cache

from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.liang2026.paper import PaperFile


@cache
def packaged_paper() -> PaperFile:
    return PaperFile.read("liang_2026", Registry())
