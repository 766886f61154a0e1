"""Packaged studies by name: those of any scene, each of which compares the alternatives of one
component, and the tables and figures of the paper."""

from pathlib import Path

from sparsemor.plugins.studies.any_scene import (
    bases,
    integrators,
    methods,
    preconditioners,
    samplers,
    solvers,
)

_HERE = Path(__file__).parent

elastic_sparsity = _HERE / "elastic_sparsity.yaml"
thermal_sparsity = _HERE / "thermal_sparsity.yaml"
slider_sparsity = _HERE / "slider_sparsity.yaml"
slider_methods = _HERE / "slider_methods.yaml"
slider_untf = _HERE / "slider_untf.yaml"
brake_sparsity = _HERE / "brake_sparsity.yaml"
brake_methods = _HERE / "brake_methods.yaml"
brake_untf = _HERE / "brake_untf.yaml"
brake_published = _HERE / "brake_published.yaml"

__all__ = ["bases", "integrators", "methods", "preconditioners", "samplers", "solvers"]
