"""What is measured on a synthetic patient: segmented lumen, perfusion map, cuff and echocardiogram, all with errors.

All that is written is a case as a real one; nothing in its folder holds the truth.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.bench.endtoend.patients import PURPOSE, Drawn
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import MM, MMHG
from coronaryuq.synthetic.patient import write_case
from coronaryuq.synthetic.perfusion_map import territories
from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.truth import Patient

BED_NOISE = 0.2
"""Relative standard deviation of the perfusion of each territory (paper, section 2.1), `perfusion.branch_sd`."""
LEAST = 0.1
"""Fraction of its true perfusion that noise leaves to a territory, at least."""
PRESSURES = ("PaoMin", "PaoMean", "PaoMax")


def write_measured(drawn: Drawn, truth: Patient, folder: Path) -> None:
    """Write the patient's case: case.yaml, tree.vtp, lv.vtu, outlets.csv, targets.csv.

    Parameters
    ----------
    drawn
        The patient; its segmented lumen is written.
    truth
        Its true states and perfusion.
    folder
        To write to.
    """
    routine = drawn.errors.routine
    measures = measured(truth.rest.measures, routine, generator(drawn.seed, PURPOSE, "cuff and echo", drawn.index))
    seen = replace(
        truth,
        anatomy=drawn.segmented,
        wall=_measured_map(drawn, truth),
        rest=replace(truth.rest, measures=measures),
        settings=truth.settings.model_copy(update={"hyperaemia": Settings().hyperaemia}),
    )
    stated = {"lumen": drawn.errors.lumen.model_dump(), "errors": routine.model_dump()}
    write_case(seen, folder, f"Synthetic patient {drawn.index} of the benchmark endtoend.", stated)


def measured(measures: Mapping[str, float], errors: RoutineErrors, random: np.random.Generator) -> dict[str, float]:
    """Return measures, CGS, with the errors of cuff and echocardiogram; those of waveforms have none."""
    found = dict(measures)
    correlation = errors.pressure_correlation
    shared = random.standard_normal()
    for name in PRESSURES:
        own = np.sqrt(correlation) * shared + np.sqrt(1.0 - correlation) * random.standard_normal()
        found[name] += errors.pressure * MMHG * own
    relative = {
        "AbsQin": errors.stroke_volume, "EDV": errors.ventricular_volume, "ESV": errors.ventricular_volume,
        "AorCorSplit": errors.coronary_share,
    }  # fmt: skip
    for name, sd in relative.items():
        found[name] *= max(1.0 + sd * random.standard_normal(), LEAST)
    found["EFLV"] += errors.ejection_fraction * random.standard_normal()
    return found


def _measured_map(drawn: Drawn, truth: Patient):
    """Return the wall with noise of every territory, a wrong calibration, and a shift."""
    random = generator(drawn.seed, PURPOSE, "map", drawn.index)
    routine, wall = drawn.errors.routine, truth.wall.copy()
    ends = [truth.anatomy.tree[outlet.vessel].points[-1] for outlet in truth.anatomy.outlets if outlet.perfuses == "LV"]
    owner = territories(np.asarray(wall.cell_centers().points, float), np.array(ends))
    own = 1.0 + BED_NOISE * drawn.errors.noise * random.standard_normal(len(ends))
    calibration = 1.0 + np.hypot(routine.mbf_calibration, routine.tissue_density) * random.standard_normal()
    factor = np.maximum(own[owner] * calibration, LEAST)
    wall.cell_data["MBF"] = np.asarray(wall.cell_data["MBF"]) * factor
    wall.points = np.asarray(wall.points) + routine.registration * MM * random.standard_normal(3)
    return wall
