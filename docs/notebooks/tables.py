"""
Results in pandas and xarray
============================

How do the numbers of a run get into one's own plots and tables? By names of probes, blocks and
components, with units.
"""
# %%
from sparsemor import load, simulate

scene = load("double_pendulum", {
    "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320, "time.end": 0.05,
    "reducer": "full",
    "probes": {"tip": {"body": "link2", "at": "bore_b"}}})
run = simulate(scene)
run

# %%
# A probe as a table of pandas, with times in s as its index.

run.to_dataframe("tip").tail()

# %%
# Joint forces, too.

run.to_dataframe("B").describe()

# %%
# With xarray, components are selected by name.

angle = run.history("link1.rigid").sel(unknown="angle")
float(angle[-1] - angle[0])

# %%
# All arrays of the run as one dataset, which becomes a file that other programs read.

data = run.to_xarray()
data.to_netcdf("pendulum.nc", engine="scipy")
data

# %%
# The moving bodies, coloured by the von Mises stress.

run.animate("stress", frames=10)
