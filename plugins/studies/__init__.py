"""Packaged studies (parameter variations of one scene) by name: each compares the alternatives of
one component."""

from pathlib import Path

_HERE = Path(__file__).parent

elastic_sparsity = _HERE / "elastic_sparsity.yaml"
thermal_sparsity = _HERE / "thermal_sparsity.yaml"
preconditioners = _HERE / "preconditioners.yaml"
samplers = _HERE / "samplers.yaml"
solvers = _HERE / "solvers.yaml"
bases = _HERE / "bases.yaml"
integrators = _HERE / "integrators.yaml"
methods = _HERE / "methods.yaml"
slider_sparsity = _HERE / "slider_sparsity.yaml"
slider_methods = _HERE / "slider_methods.yaml"
slider_untf = _HERE / "slider_untf.yaml"
brake_sparsity = _HERE / "brake_sparsity.yaml"
brake_methods = _HERE / "brake_methods.yaml"
brake_untf = _HERE / "brake_untf.yaml"
brake_published = _HERE / "brake_published.yaml"
