"""Meshes: from centrelines, surfaces or an existing folder to a SimVascular `mesh-complete/` folder and `mesh.json`.

Several pieces (three stenosed segments, say) are one mesh with disconnected components: one folder, one pressure
matrix. Lengths in cm, areas in cm2, volumes in cm3. Nodes are numbered in reverse Cuthill-McKee order.

`mesh-complete/`: `mesh-complete.mesh.vtu` (GlobalNodeID, GlobalElementID from 1), `mesh-complete.exterior.vtp`,
`walls_combined.vtp`, `mesh-surfaces/NAME.vtp`. Surfaces carry point data GlobalNodeID, cell data GlobalElementID (the
tetrahedron behind), ModelFaceID, and Region: the `id` of the stenosis region that a wall triangle belongs to, else 0.
Read with `mesh.folder.read(folder) -> Mesh`. `mesh-complete.zip` is the same folder in one file of reproducible bytes.

`mesh.json`:

    format     "coronaryuq-mesh-1"
    domain     "segments" | "trees" | "whole" | "surface" | "given"
    nodes, tets, volume
    pieces     [{vessel: [start, end]}]: arc intervals of the tree's vessels in each piece
    faces      [{name, kind: "wall" | "cap", ModelFaceID, area, and for caps: centroid, normal (outward, unit),
                 radius (of equal area), couples}]
    couples    {upstream: A, downstream: B, flow: "in" | "out"}: the cap cuts the connection A:B, as svZeroDSolver
               writes it; blood enters 3D there ("in": A stays 0D) or leaves it ("out": B stays 0D). Where a 0D vessel
               is cut in the middle, A and B are that vessel: "in" leaves its upstream part in 0D, "out" the downstream.
    replaces   names of the 0D vessels wholly inside 3D
    cut        {vessel: {"upstream": shares, "downstream": shares}} for vessels cut in the middle: what stays in 0D on
               either side, as a fraction of each element, shares = {R_poiseuille, L, C, stenosis_coefficient}
    regions    {stenosis: {id, vessel, throat (arc), throat_radius, from, to (along the artery, relative to the throat),
               triangles, area}}: wall for min TAWSS and max OSI
    planes     {stenosis: {point, normal (downstream, unit), radius, vessel, arc, distance_from_throat}}: where the
               distal pressure of FFR is read
    quality    {radius_ratio_min, radius_ratio_mean, dihedral_min, dihedral_max, altitude_min, tets_on_wall_only,
               throat_resolution: {stenosis: R/h}}
    failed_attempts  meshing attempts that failed before one succeeded, one line each
    settings   the settings it was made with

`mesh.remainder.remaining_network(network, mesh_json)` gives the 0D network that is left, as svZeroDSolver JSON with one
coupling block to each cap, named as the cap.

`mesh.stage.make_mesh` is the rule (from centrelines); `mesh.given` takes the patient's own lumen, a closed surface or
an existing folder, with the tree of the same anatomy.
"""
