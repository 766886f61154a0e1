"""
First run and comparison
========================

Is a reduced model of a scene good enough, and how much faster is it? A run at full order and one
with few unknowns, side by side.
"""
# %%
# A scene is data: bodies, joints, loads, a method. This one is packaged, here with a coarser mesh
# and a short run.

from sparsemor import compare, load, simulate

scene = load("double_pendulum", {
    "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
    "time.end": 0.1, "training": {"end": 0.05}})
scene

# %%
# The full-order run. What it has computed, and what it warns of, is in the table.

full = simulate(scene.using({"reducer": "full"}), progress=True)
full

# %%
# The same with 20 displacement and 20 temperature unknowns for each link, from a training run over
# the first half.

reduced = simulate(scene.using({"reducer": {"use": "galerkin", "basis": {
    "use": "pod", "count": 20}}}), progress=True)

# %%
# Errors are the largest over time, relative to the largest change of each field.

both = compare(full, reduced=reduced)
both

# %%
both.plot("error_over_time")

# %%
# The bodies at some times, coloured by temperature.

reduced.plot("temperature", times=[0.0, 0.05, 0.1])
