"""A synthetic patient as files, in the formats of a real case, and the truth."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.core.units import MMHG
from coronaryuq.synthetic.truth import Patient, State, bed_name
from coronaryuq.zerod.network.beds import distal_resistances

CLINICAL = {
    "PaoMin": ("Minimum Aortic Pressure", MMHG, 0),
    "PaoMax": ("Maximum Aortic Pressure", MMHG, 0),
    "PaoMean": ("Mean Aortic Pressure", MMHG, 0),
    "AorCorSplit": ("Coronary Flow Split", 1.0, 1),
    "AbsQin": ("Stroke Volume", 1.0, 0),
    "Qsystole_perc": ("Percentage of cardiac output in systole", 1.0, 2),
    "PpulMean": ("Mean Pulmonary Pressure", MMHG, 0),
    "EFLV": ("Left Ventricular Ejection Fraction", 1.0, 2),
    "ESV": ("End Systolic Volume", 1.0, 0),
    "EDV": ("End Diastolic Volume", 1.0, 0),
    "QlaRatio": ("Left atrioventricular early/late flow ratio", 1.0, 1),
    "mitValveTime": ("Mitral Valve Opening Time", 1.0, None),
    "aorValveTime": ("Aortic Valve Opening Time", 1.0, 2),
    "pulValveTime": ("Pulmonary Valve Opening Time", 1.0, None),
    "PraMean": ("Mean Right Atrial Pressure", MMHG, 0),
    "LCorMaxRatio": ("Diastolic/Systolic maximum flow ratio in left coronary", 1.0, 1),
    "LCorTotRatio": ("Diastolic/Systolic total flow ratio in left coronary", 1.0, 1),
    "LThirdFF": ("Left coronary 1/3 flow fraction", 1.0, 2),
    "LHalfFF": ("Left coronary 1/2 flow fraction", 1.0, 2),
    "LGradOK": ("Checking amount of peaks/valleys in left coronary wave", 1.0, 0),
    "RCorMaxRatio": ("Diastolic/Systolic maximum flow ratio in right coronary", 1.0, 1),
    "RCorTotRatio": ("Diastolic/Systolic total flow ratio in right coronary", 1.0, 1),
    "RThirdFF": ("Right coronary 1/3 flow fraction", 1.0, 2),
    "RHalfFF": ("Right coronary 1/2 flow fraction", 1.0, 2),
    "RGradOK": ("Checking amount of peaks/valleys in right coronary wave", 1.0, 0),
}
"""Clinical report: description, unit in CGS, decimals; None if the target was not measured."""


def write_files(patient: Patient, folder: str | Path) -> None:
    """Write the bundled patient's case, see `write_case`, and truth.json before case.yaml."""
    write_json(Path(folder) / "truth.json", truth(patient))
    write_case(patient, folder, "Synthetic right-dominant patient with one stenosis each in LAD, LCx and RCA.")


def write_case(patient: Patient, folder: str | Path, text: str, also: Mapping[str, Any] | None = None) -> None:
    """Write tree.vtp, lv.vtu, outlets.csv, targets.csv and, last, case.yaml.

    Parameters
    ----------
    patient
        Its anatomy, wall with map, measures at rest and settings.
    folder
        To write to.
    text
        Free text for readers.
    also
        Further fields of `case.yaml`.
    """
    folder = Path(folder)
    anatomy = patient.anatomy
    write_tree(folder / "tree.vtp", anatomy.tree)
    write_vtk(folder / "lv.vtu", patient.wall)
    outlets = [
        {"name": o.vessel, "vessel": o.vessel, "perfuses": o.perfuses, "branch": o.branch, "label": o.label}
        for o in anatomy.outlets
    ]
    write_csv(folder / "outlets.csv", pd.DataFrame(outlets))
    write_text(folder / "targets.csv", clinical_targets(patient.rest.measures))
    write_text(folder / "case.yaml", description(patient, text, also or {}))


def clinical_targets(measures: Mapping[str, float]) -> str:
    """Write the targets table: name, description, value in mmHg or mL, rounded as in a clinical report, or `none`."""
    lines = []
    for name, (text, unit, decimals) in CLINICAL.items():
        value = "none" if decimals is None else f"{measures[name] / unit:.{decimals}f}"
        lines.append(f"{name},{text},{value}\n")
    return "".join(lines)


def description(patient: Patient, text: str, also: Mapping[str, Any]) -> str:
    """Write `case.yaml` of the patient; also: further fields."""
    settings = patient.settings
    stenoses = "".join(
        f"\n  - {{name: {s.name}, vessel: {s.vessel}, start: {float(s.start)!r}, end: {float(s.end)!r}}}"
        for s in patient.anatomy.stenoses
    )
    return (
        f"name: {settings.name}\n"
        f"description: {text}\n"
        "anatomy: {centrelines: tree.vtp, unit: cm}\n"
        "perfusion: {file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: cm}\n"
        "outlets: outlets.csv\n"
        "targets: targets.csv\n"
        f"period: {settings.period:.6g}\n"
        f"hyperaemia: {settings.hyperaemia:.6g}\n"
        f"stenoses:{stenoses or ' []'}\n"
        # The paper's places; the truth of the patient is there, too.
        "ffr_beyond_mm: null\n" + (yaml.safe_dump(dict(also), sort_keys=False) if also else "")
    )


def truth(patient: Patient) -> dict:
    """Return the patient's true values, CGS, of the estimated quantities, and the loop with these values."""
    rest, hyperaemia = patient.rest, patient.hyperaemia
    return {
        "name": patient.settings.name,
        "settings": patient.settings.model_dump(),
        "heart": rest.network.heart["parameters"],
        "distal_resistance": distal_resistances(hyperaemia.network),
        "territory_mass": patient.masses,
        "lv_beds": [bed_name(o.vessel) for o in patient.anatomy.outlets if o.perfuses == "LV"],
        "effects": [],
        "rest": _condition(rest),
        "hyperaemia": _condition(hyperaemia),
    }


def _condition(state: State) -> dict:
    return {"flows": state.flows, "ffr": state.ffr, "measures": state.measures, "network": state.network}
