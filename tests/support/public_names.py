"""Modules whose names third parties import, and those that a source imports from."""

import ast

MODULES = {f"sparsemor.core.{name}" for name in (
    "linalg.column_subsets", "linalg.dense", "linalg.linear_solver_checks",
    "linalg.nested_dissection", "linalg.snapshots", "linalg.threads",
    "model.assembly", "model.block_patterns", "model.compressed_local",
    "model.constraint_rates", "model.equations", "model.expected_states", "model.facets",
    "model.factorizations", "model.fitting_bases", "model.initial_state",
    "model.linear_equations", "model.model", "protocols.body", "protocols.body_frame",
    "protocols.cells", "protocols.contributions", "protocols.integrator", "protocols.joint",
    "protocols.layout", "protocols.load_tables", "protocols.mesh", "protocols.poses",
    "protocols.reducer", "protocols.separable", "protocols.sparse_solver",
    "protocols.step_amplitude", "protocols.step_solver", "protocols.term",
    "protocols.time_function",
    "registry.returned_values", "results.relative_error_estimates", "scene.expressions",
    "scene.option_tree", "simulation.cache", "simulation.memory.estimate",
    "simulation.memory.limits", "simulation.time_stepping")} | {
        "sparsemor.plugins.comparison.error_norms"}
"""Modules for some plugins, which docs/reference/modules.md lists."""
PUBLIC = {"sparsemor", "sparsemor.bodies", "sparsemor.core", "sparsemor.core.testing",
          "sparsemor.reducers", *MODULES}


def ours(source: str) -> set[str]:
    """Modules of sparsemor that a source imports names from."""
    tree = ast.walk(ast.parse(source))
    found = {(n.module or "") if isinstance(n, ast.ImportFrom) else a.name
             for n in tree if isinstance(n, ast.Import | ast.ImportFrom)
             for a in n.names}
    return {m for m in found if m.split(".")[0] == "sparsemor"}
