"""
A body of one's own mesh
========================

How does a mesh file become a body with joints and loads? A bracket, written here as a file of
Gmsh; files of Abaqus, Nastran and others are read in the same way.
"""
# %%
# The mesh: quadrilaterals over an L, in millimetres, and the facets of two groups.

from itertools import product

import meshio
import numpy as np

x, y = np.linspace(0, 100, 26), np.linspace(0, 100, 26)
number = {(i, j): 26 * i + j for i, j in product(range(26), repeat=2)}
quads = [[number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]]
         for i, j in product(range(25), repeat=2) if i < 6 or j < 6]
wall = [[number[0, j], number[0, j + 1]] for j in range(25)]
end = [[number[25, j], number[25, j + 1]] for j in range(6)]
tags = [np.full(len(wall + end), 3), np.full(len(quads), 1)]
tags[0][:len(wall)] = 2
points = np.array([[x[i], y[j], 0.0] for i, j in number])
meshio.Mesh(
    points, [("line", wall + end), ("quad", quads)],
    cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
    field_data={"steel": np.array([1, 2]), "wall": np.array([2, 1]), "end": np.array([3, 1])},
).write("bracket.msh", file_format="gmsh22", binary=False)

# %%
# Which sets are in the file, and a scene to begin with: the command asks for what it needs, or
# takes it from its options.

import subprocess
import sys

print(subprocess.run(
    [sys.executable, "-m", "sparsemor", "init", "bracket.msh", "--scale", "1e-3",
     "--hold", "wall", "--load", "end", "--out", "bracket.yaml"],
    capture_output=True, text=True).stdout)
print(open("bracket.yaml").read())

# %%
# It runs as it is.

from sparsemor import load, simulate

run = simulate(load("bracket.yaml"))
run.plot("stress")

# %%
# A wrong name is one message, with the line of the file and the names that there are.

from sparsemor import InputError

try:
    simulate(load("bracket.yaml", {"loads.push.on": "bracket:ent"}))
except InputError as error:
    print(error)
