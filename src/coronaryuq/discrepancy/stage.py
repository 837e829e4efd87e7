"""The rules of the discrepancy campaign: one function each, paths and settings to files."""

from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import Condition, read_conditions
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.reference_gap import known_gap
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.read_problem import read_problem, with_noise
from coronaryuq.discrepancy.result.write import gap_row
from coronaryuq.discrepancy.search_case import search_case
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine

HYPERAEMIA = 0.24
LARGEST = 3


def hide_in_loop(rest: str | Path, settings: Settings, seed: int, folder: str | Path) -> None:
    """Make a case with a hidden effect from a tuned loop: three files of the case, and `truth.json` for the reader.

    Measured in rest, hyperaemia, pacing and (held out) half dilatation: pressure at the root and before the three
    largest coronary beds, flow into each coronary artery, perfusion of every bed.
    """
    folder, network = Path(folder), read_network(rest)
    one = effect(settings.hidden_effect)
    conditions, plan = loop_conditions(), plan_of(network)
    random = generator(seed, "discrepancy", "place")
    inside = [e for e in plan.entries if e[0] == "pressure"][1:]
    fed = [location.split(":")[0] for _, location, _, _ in inside]
    places = one.places(Anatomy(network), make_case.series_of(plan, conditions))
    if not places:
        raise InputError("configuration", "discrepancy.hidden_effect", one.name, "has no place in this loop")
    # Before a bed whose pressure is measured an effect leaves its trace.
    places = [vessel for vessel in fed if vessel in places] or places
    place = places[int(random.integers(len(places)))]
    hypothesis = Hypothesis((PlacedEffect(one, place),))
    sizes = np.full(len(one.parameters), settings.hidden_size)
    truth = make_case.hide(network, {c.name: c for c in conditions}, plan, hypothesis, sizes, 1.0, seed, folder)
    write_json(
        folder / "truth.json",
        {
            "effect": one.name,
            "place": place,
            "size_z": settings.hidden_size,
            "sizes": {p.name: float(p.from_standard(settings.hidden_size)) for p in one.parameters},
            "visible_sd": truth.visible,
        },
    )


def loop_conditions() -> list[Condition]:
    """Rest, hyperaemia and pacing to fit, half a dilatation to keep out of every fit."""
    return [
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=HYPERAEMIA),
        Condition("pacing", period_scale=0.75),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    ]


def plan_of(network: Network) -> make_case.Plan:
    """What a catheter laboratory and a perfusion scan would measure on any network."""
    anatomy = Anatomy(network)
    beds = anatomy.beds
    names = {bed: f"mean_flow:{vessel}:{bed}" for bed, vessel in beds.items()}
    found = Engine(network).run(quantities=list(names.values()), periodic=True, steps_per_cycle=300)
    if not found.ok[0]:
        raise InputError("model", None, None, f"the loop does not run: {found.status[0]}")
    order = sorted(beds, key=lambda bed: -float(found.values[names[bed]][0]))
    entries = [("pressure", anatomy.inlet(anatomy.roots[0]), "waveform", 0.02)]
    entries += [("pressure", f"{beds[bed]}:{bed}", "waveform", 0.02) for bed in order[:LARGEST]]
    entries += [("flow", anatomy.inlet(vessel), "waveform", 0.05) for vessel in anatomy.ostia]
    entries += [("perfusion", bed, "mean", 0.08) for bed in beds]
    return make_case.Plan(tuple(entries))


def search(
    model, measurements, conditions, settings: Settings, seed: int, folder: str | Path, threads: int = 1
) -> None:
    """Search one case and write the results into `folder`."""
    search_case(model, measurements, conditions, Path(folder), settings.model_copy(update={"threads": threads}), seed)


def compare(
    case: dict[str, str],
    truth: str,
    found: dict[str, str],
    settings: Settings,
    seed: int,
    out: dict[str, str],
    threads: int = 1,
) -> None:
    """Put the held-out gap with the true effect beside those of a search, in a table and a JSON; noise is what the
    search took it to be.

    case: model, measurements and conditions; truth: what `hide_in_loop` says of them; found: `gaps`, the search's
    table, and `answer`, its JSON; out: table and reference.
    """
    settings = settings.model_copy(update={"threads": threads})
    conditions = read_conditions(case["conditions"])
    problem = read_problem(read_network(case["model"]), case["measurements"], conditions, case["conditions"], settings)
    told = read_json(found["answer"], ("noise",))["noise"]
    noise = {quantity: Noise(**one) for quantity, one in told.items()}
    hidden_there = read_json(truth, ("effect", "place", "size_z"))
    one = effect(hidden_there["effect"])
    hypothesis = Hypothesis((PlacedEffect(one, hidden_there["place"]),))
    sizes = np.full(len(one.parameters), hidden_there["size_z"])
    with threadpool_limits(1):
        known = known_gap(with_noise(problem, noise) if noise else problem, hypothesis, sizes, seed)
    table = read_csv(found["gaps"])
    row = pd.DataFrame([gap_row("with the true effect", known)], columns=table.columns)
    write_csv(Path(out["table"]), pd.concat([table, row], ignore_index=True))
    write_json(Path(out["reference"]), known.summary())
