"""
A kept model and its inputs
===========================

How does a reduced model get into another program? It is made once, kept in a file, and stepped
with inputs from outside.
"""
# %%
from sparsemor import load, load_model, reduce

scene = load({
    "bodies": {"bar": {
        "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"], "order": 2,
        "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                 "divisions": [16, 4]},
        "sets": {"end_a": {"nearest": [0.0, 0.0]}, "end_b": {"nearest": [0.5, 0.0]}},
        "material": {"E": 7.0e8, "nu": 0.3, "rho": 2700, "alpha": 2.0e-5, "k": 1500, "c": 90},
        "reference": {"chord": ["end_a", "end_b"]}, "damping": {"stiffness": 1.0e-3}}},
    "joints": {"pin": {"use": "revolute", "between": ["ground", "bar:left"]}},
    "loads": {"weight": {"use": "gravity", "factor": 1.0},
              "heat": {"use": "heat_flux", "on": ["bar:right"], "flux": 1.0e6}},
    "time": {"end": 0.2, "step": 1.0e-3},
    "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
    "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 8}},
    "probes": {"end": {"body": "bar", "at": "end_b"}},
})
model = reduce(scene, progress=True)
model

# %%
# What a run may change without a new model: here the heat, on the model read from its file.

model.save("bar.model")
kept = load_model("bar.model")
half = kept.run({"loads.heat.flux": 5.0e5})
half.plot("probe_temperature")

# %%
# Step by step, with a thermostat around it.

stepper = kept.stepper(["loads.heat.flux"], ["end.temperature"])
switched, warm = 0, True
while stepper.t < 0.199:
    cold = stepper.get("end.temperature") < 297.0
    switched += cold != warm
    warm = cold
    stepper.set("loads.heat.flux", 1.0e6 if cold else 0.0)
    stepper.step()
print(f"{stepper.get('end.temperature'):.2f} K after {switched} switches")
