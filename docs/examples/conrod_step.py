"""Writes conrod.step, the connecting rod of engine.yaml (extra gmsh)."""

import gmsh

LENGTH = 140.0                                  # mm, between the bores
gmsh.initialize()
occ = gmsh.model.occ
gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
rod, _ = occ.fuse(
    [(3, occ.addCylinder(0, 0, -10, 0, 0, 20, 32))],
    [(3, occ.addCylinder(LENGTH, 0, -10, 0, 0, 20, 18)),
     (3, occ.addBox(0, -10, -7, LENGTH, 20, 14))])
bores = [occ.addCylinder(x, 0, -11, 0, 0, 22, radius) for x, radius in ((0, 22), (LENGTH, 11))]
pockets = [occ.addBox(42, -5, z, 72, 10, 5) for z in (3.5, -8.5)]
rod, _ = occ.cut(rod, [(3, tool) for tool in (*bores, *pockets)])
occ.synchronize()
print(f"{occ.getMass(*rod[0]):.3f} mm3")
gmsh.write("conrod.step")
gmsh.finalize()
