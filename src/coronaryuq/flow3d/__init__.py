"""3D flow: meshes, the ensemble solver, the SimVascular adapters, wall shear stress and FFR."""
