"""Centrelines by VMTK, in a Python of its own: VMTK has no wheel for the project's.

Run as `python vmtk_lines.py SURFACE.vtp SEEDS.json OUT.vtp`: one line from the source to each target.
"""

import json
import sys
from pathlib import Path


def main(surface: str, seeds: str, out: str) -> None:
    from vmtk import vmtkscripts
    from vtk import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

    reader = vtkXMLPolyDataReader()
    reader.SetFileName(surface)
    reader.Update()
    given = json.loads(Path(seeds).read_text())
    lines = vmtkscripts.vmtkCenterlines()
    lines.Surface = reader.GetOutput()
    lines.SeedSelectorName = "pointlist"
    lines.SourcePoints = given["source"]
    lines.TargetPoints = [x for target in given["targets"] for x in target]
    lines.AppendEndPoints = 1
    lines.Resampling, lines.ResamplingStepLength = 1, given["step"]
    lines.Execute()
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(out)
    writer.SetInputData(lines.Centerlines)
    writer.Write()


if __name__ == "__main__":
    main(*sys.argv[1:])
