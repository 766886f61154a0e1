"""Packages whose names third parties import, and those that a source imports from."""

import ast

PUBLIC = {"sparsemor", "sparsemor.bodies", "sparsemor.core", "sparsemor.core.testing",
          "sparsemor.reducers"}


def ours(source: str) -> set[str]:
    """Modules of sparsemor that a source imports names from."""
    tree = ast.walk(ast.parse(source))
    found = {(n.module or "") if isinstance(n, ast.ImportFrom) else a.name
             for n in tree if isinstance(n, ast.Import | ast.ImportFrom)
             for a in n.names}
    return {m for m in found if m.split(".")[0] == "sparsemor"}
