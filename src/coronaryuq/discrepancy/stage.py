"""Stages of the discrepancy campaign: one function per rule, from files and settings to files."""

from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.experiment import loop_experiment
from coronaryuq.discrepancy.hidden.reference_gap import known_gap
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.outliers import Outlier
from coronaryuq.discrepancy.inference.read_problem import read_problem, with_noise
from coronaryuq.discrepancy.result.write import gap_row
from coronaryuq.discrepancy.selection.observed_noise import with_uneven_noise
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network


def hide_in_loop(rest: str | Path, settings: Settings, seed: int, out_dir: str | Path) -> None:
    """Write a case with a hidden effect in a tuned loop, and `truth.json` for the report.

    Parameters
    ----------
    rest
        Tuned loop, svZeroDSolver JSON.
    settings
        Effect to hide and its size.
    seed
        Seed of the place, the nuisance parameters and the noise.
    out_dir
        Folder for `model.json`, `measurements.csv`, `conditions.yaml` and `truth.json`.

    Raises
    ------
    InputError
        If the effect has no place in the loop.
    """
    folder, experiment = Path(out_dir), loop_experiment(read_network(rest))
    hidden = effect(settings.hidden_effect)
    places = hidden.places(Anatomy(experiment.network), experiment.series)
    if not places:
        raise InputError("configuration", "discrepancy.hidden_effect", hidden.name, "has no place in this loop")
    # An effect in a vessel whose distal pressure is measured is detectable.
    pressures = [location for quantity, location, _, _ in experiment.plan.entries if quantity == "pressure"]
    measured = [location.split(":")[0] for location in pressures[1:]]
    places = [vessel for vessel in measured if vessel in places] or places
    place = places[int(generator(seed, "discrepancy", "place").integers(len(places)))]
    hypothesis = Hypothesis((PlacedEffect(hidden, place),))
    sizes = np.full(len(hidden.parameters), settings.hidden_size)
    truth = make_case.hide(experiment, hypothesis, sizes, make_case.Noise(), seed, folder)
    write_json(
        folder / "truth.json",
        {
            "effect": hidden.name,
            "place": place,
            "size_z": settings.hidden_size,
            "sizes": {p.name: float(p.from_standard(settings.hidden_size)) for p in hidden.parameters},
            "visible_sd": truth.visible,
        },
    )


def compare(
    case: dict[str, str],
    truth: str,
    found: dict[str, str],
    settings: Settings,
    seed: int,
    out: dict[str, str],
    threads: int = 1,
) -> None:
    """Add the held-out gap with the true effect to the gaps of a search.

    Parameters
    ----------
    case
        Paths of `model`, `measurements` and `conditions`.
    truth
        `truth.json` of `hide_in_loop`.
    found
        `gaps`, the table of the search, and `answer`, its JSON with the noise that it estimated.
    settings, seed, threads
        As of the search.
    out
        `table`, the gaps with the additional row, and `reference`, the additional gap as JSON.
    """
    settings = settings.model_copy(update={"threads": threads})
    conditions = read_conditions(case["conditions"])
    problem = read_problem(read_network(case["model"]), case["measurements"], conditions, case["conditions"], settings)
    answer = read_json(found["answer"], ("noise", "uneven_noise", "outliers"))
    problem = with_uneven_noise(problem, answer["uneven_noise"])
    noise = {quantity: Noise(**values) for quantity, values in answer["noise"].items()}
    hidden = read_json(truth, ("effect", "place", "size_z"))
    hypothesis = Hypothesis((PlacedEffect(effect(hidden["effect"]), hidden["place"]),))
    sizes = np.full(len(hypothesis.parameters), hidden["size_z"])
    with threadpool_limits(1):
        if noise or answer["outliers"]:
            problem = with_noise(problem, noise, [Outlier(**one) for one in answer["outliers"]])
        known = known_gap(problem, hypothesis, sizes, seed)
    table = read_csv(found["gaps"])
    row = pd.DataFrame([gap_row("with the true effect", known)], columns=table.columns)
    write_csv(Path(out["table"]), pd.concat([table, row], ignore_index=True))
    write_json(Path(out["reference"]), known.summary())
