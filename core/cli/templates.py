"""Texts of a new third-party package; `$name` and the like are filled in."""

PYPROJECT = """\
[build-system]
requires = ["hatchling>=1.26"]
build-backend = "hatchling.build"

[project]
name = "$distribution"
version = "0.1.0"
requires-python = ">=3.11"
dependencies = ["sparsemor"]

[project.entry-points."sparsemor.$kind"]
$name = "$module:$cls"

[tool.hatch.build.targets.wheel]
only-include = ["$module.py"]
"""

README = """\
# $distribution

The $kind `$name` for sparsemor. After `pip install -e .` a scene can say `$kind: $name`, and
`sparsemor plugins $name` lists its options. `pytest` checks the laws of its kind.
"""

LAW_TEST = """\
from $module import $cls
from sparsemor.core.testing import check_$kind


def test_laws() -> None:
    check_$kind($cls())
"""

_SAMPLER = '''\
"""A sampler for sparsemor."""

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import BlockData, Dictionary


class $cls(Plugin):
    """Rows at equal distances in the order of the unknowns."""

    start: int = Field(default=0, ge=0)
    """First row, counted among those that are not required."""

    def sample(
        self, block: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        free = np.setdiff1d(np.arange(block.size), required)
        if m > free.size:
            raise InputError(f"{m} rows of {block.name} are wanted, only {free.size} are left")
        picked = (self.start + np.arange(m) * free.size // max(m, 1)) % max(free.size, 1)
        return np.union1d(required, free[picked])
'''

_BASIS = '''\
"""A basis for sparsemor."""

import numpy as np
from pydantic import Field

from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import BlockData, Dictionary


class $cls(Plugin):
    """Left singular vectors of the snapshots."""

    rtol: float = Field(default=1e-10, gt=0, lt=1)
    """Singular values below rtol times the largest are dropped (-)."""

    @property
    def needs_snapshots(self) -> bool:
        return True

    def build(self, data: BlockData) -> Dictionary:
        A = data.snapshots
        if not (A.any() and np.isfinite(A).all()):
            raise InputError(f"the snapshots of {data.name} are absent, zero or not finite")
        u, s, _ = np.linalg.svd(A, full_matrices=False)
        atoms = u[:, s > self.rtol * s[0]]
        names = tuple(f"{data.name}[{i}]" for i in range(atoms.shape[1]))
        return Dictionary(atoms, np.zeros(data.size), names)
'''

_PRECONDITIONER = '''\
"""A preconditioner for sparsemor."""

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import FloatArray
from sparsemor.core.plugin import Plugin


class $cls(Plugin):
    """Scales every row to unit norm."""

    floor: float = Field(default=1e-8, gt=0)
    """Rows below floor times the longest are left at that length (-)."""

    def check(self, rows: int, atoms: int) -> str:
        return ""

    def build(self, A: FloatArray) -> FloatArray:
        lengths = np.linalg.norm(A, axis=1)
        smallest = max(self.floor * lengths.max(initial=0.0), np.finfo(float).tiny)
        return np.diag(1.0 / np.maximum(lengths, smallest))
'''

KINDS = {"sampler": _SAMPLER, "basis": _BASIS, "preconditioner": _PRECONDITIONER}
"""Kind -> text of the plugin's module."""
