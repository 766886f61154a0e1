"""
A study and its chart
=====================

How many unknowns, of which method? Every combination is one run, all against the same run at full
order.
"""
# %%
# A study is data, too: changes to a scene, each list an axis.

from sparsemor import study

bar = {
    "bodies": {"bar": {
        "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"], "order": 2,
        "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                 "divisions": [16, 4]},
        "sets": {"end_a": {"nearest": [0.0, 0.0]}, "end_b": {"nearest": [0.5, 0.0]}},
        "material": {"E": 7.0e8, "nu": 0.3, "rho": 2700, "alpha": 2.0e-5, "k": 1500, "c": 90},
        "reference": {"chord": ["end_a", "end_b"]}, "damping": {"stiffness": 1.0e-3}}},
    "joints": {"pin": {"use": "revolute", "between": ["ground", "bar:left"]}},
    "loads": {"weight": {"use": "gravity"},
              "heat": {"use": "heat_flux", "on": ["bar:right"], "flux": 1.0e5}},
    "time": {"end": 0.2, "step": 1.0e-3}, "training": {"end": 0.1},
    "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
}
table = study({
    "title": "How many atoms",
    "grid": {"reducer": ["galerkin", "sparse"], "reducer.basis.count": [2, 4, 8]},
    "method": "reducer", "budget": "reducer.basis.count", "errors_from": 0.1,
}, bar, out="atoms", progress=True)
table

# %%
# Error after the end of training against time per step.

table.plot()

# %%
# The rows are plain data, for pandas or a file.

import pandas as pd

pd.DataFrame(table)[["reducer", "reducer.basis.count", "status", "late_elastic", "late_thermal"]]
