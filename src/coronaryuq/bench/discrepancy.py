"""Benchmark `discrepancy`: hidden effects, named from a model that lacks them and a table of noisy measurements."""

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq import files, units
from coronaryuq.discrepancy import hidden, openloop
from coronaryuq.discrepancy.conditions import Condition, read_conditions
from coronaryuq.discrepancy.model import read_problem
from coronaryuq.discrepancy.output import named
from coronaryuq.discrepancy.search import Discovery, discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.verify import gap, linearise
from coronaryuq.seeds import generator
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.grafting import add_vessel, attach
from coronaryuq.zerod.effects.library import LIBRARY, effect

STRENGTHS = {"weak": (-1.0, 0.6), "medium": (0.0, 1.2), "strong": (1.0, 2.0)}
"""Sizes in prior standard deviations: of positive sizes, and the magnitude of signed ones."""
NOISES = {"half": 0.5, "nominal": 1.0, "double": 2.0}
LEAST_VISIBLE = 6.0
"""Hidden effects whose trace in the fitted data is below this many noise sd are drawn again elsewhere, and counted."""
DRAWS = 6
NOTHING_PER_SEED = 5
"""Cases with nothing hidden per seed: one discovery ends after its first step, and a small share wants many."""
PAIRS_OF_TWO = (
    ("quadratic_stenosis", "pressure_offset"),
    ("diffuse_narrowing", "mbf_underestimation"),
    ("intramyocardial_pressure", "quadratic_stenosis"),
    ("back_pressure", "flow_gain"),
)


@dataclass(frozen=True)
class Case:
    """One hidden case before it is made. effects: names; places are drawn by `seed`."""

    effects: tuple[str, ...]
    strength: str
    noise: str
    seed: int
    outside: str = ""


def open_loop() -> tuple[dict, dict[str, Condition], hidden.Plan]:
    """Network, conditions and measurements of the bundled open-loop tree driven by aortic pressure."""
    conditions = [
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=0.3),
        Condition("pacing", period_scale=0.7),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    ]
    waveforms = [
        ("flow", "AORTA:left_main", 0.04),
        ("flow", "J0:lad_proximal", 0.04),
        ("flow", "lcx:BC_lcx", 0.05),
        ("pressure", "AORTA:left_main", 0.02),
        ("pressure", "lad:BC_lad", 0.02),
        ("pressure", "lcx:BC_lcx", 0.02),
    ]
    entries = [(quantity, place, "waveform", sd) for quantity, place, sd in waveforms]
    entries += [("perfusion", f"BC_{bed}", "mean", 0.08) for bed in ("lad", "diagonal", "lcx")]
    return openloop.left_coronary(), {c.name: c for c in conditions}, hidden.Plan(tuple(entries))


def _outside(name: str, network: dict):
    """A change of a condition's network that no effect of the library expresses."""
    order = {"rest": 0.0, "hyperaemia": 1.0, "pacing": 2.0, "half dilated": 1.5}

    def scale(network, names, factor):
        for block in network["boundary_conditions"]:
            if block["bc_name"] == names:
                for key in ("Ra1", "Ra2", "Rv1"):
                    block["bc_values"][key] *= factor
        for vessel in network["vessels"]:
            if vessel["vessel_name"] == names:
                vessel["zero_d_element_values"]["R_poiseuille"] *= factor
        return network

    def miswired(network, condition):
        first, second = (
            next(b for b in network["boundary_conditions"] if b["bc_name"] == n) for n in ("BC_lad", "BC_lcx")
        )
        first["bc_values"], second["bc_values"] = second["bc_values"], first["bc_values"]
        third = next(b for b in network["boundary_conditions"] if b["bc_name"] == "BC_diagonal")
        third["bc_values"], second["bc_values"] = second["bc_values"], third["bc_values"]
        return network

    def pump(network, condition):
        """Intramyocardial pressure of the LAD's bed turned upside down: an aneurysm that bulges in systole."""
        for block in network["boundary_conditions"]:
            if block["bc_name"] == "BC_lad":
                pressure = np.asarray(block["bc_values"]["Pim"])
                block["bc_values"]["Pim"] = (pressure.max() + pressure.min() - pressure).tolist()
        return network

    def thrombosed(network, condition):
        """A side vessel behind the left main's first branch that lets blood through in late diastole only."""
        aorta = next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == "AORTA")
        open_late = np.arange(len(aorta["t"])) > 0.55 * len(aorta["t"])
        beyond = np.where(open_late, 5.0 * units.MMHG, aorta["P"])
        block = {"bc_name": "CLOT", "bc_type": "PRESSURE", "bc_values": {"t": list(aorta["t"]), "P": beyond.tolist()}}
        network["boundary_conditions"].append(block)
        number = add_vessel(network, "side", {"R_poiseuille": 85.0 * units.MMHG / 0.8}, outlet="CLOT")
        attach(network, "J1", "outlet", number)
        return network

    return {
        "thrombosed_side_vessel": thrombosed,
        "drifting_vessel": lambda n, c: scale(n, "lad_proximal", 1.0 + 12.0 * order[c]),
        "drifting_bed": lambda n, c: scale(n, "BC_lcx", 1.0 + 0.5 * order[c]),
        "miswired_outlets": miswired,
        "bulging_territory": pump,
    }[name]


OUTSIDE = ("thrombosed_side_vessel", "drifting_vessel", "drifting_bed", "miswired_outlets", "bulging_territory")


def cases(quick: bool, seeds: int, strengths: tuple[str, ...], noises: tuple[str, ...], offset: int) -> Iterator[Case]:
    """The benchmark's cases: a handful when quick, else every effect of the library and the special cells."""
    if quick:
        yield Case((), "none", "nominal", 1)
        yield Case(("quadratic_stenosis",), "medium", "nominal", 2)
        yield Case((), "medium", "nominal", 3, "bulging_territory")
        return
    for seed in range(offset, offset + seeds):
        for noise in noises:
            for number in range(NOTHING_PER_SEED):
                yield Case((), "none", noise, seed + 1000 * number)
            for strength in strengths:
                for one in LIBRARY:
                    yield Case((one.name,), strength, noise, seed)
        for name in OUTSIDE:
            yield Case((), "medium", "nominal", seed, name)
        for pair in PAIRS_OF_TWO:
            yield Case(pair, "medium", "nominal", seed)


def run(
    quick: bool,
    seeds: int = 1,
    strengths: tuple[str, ...] = ("medium",),
    noises: tuple[str, ...] = ("nominal",),
    offset: int = 100,
    seconds: float | None = None,
) -> dict:
    """Hide, discover, score; see BENCHMARKS for the keys.

    seeds: repetitions of every cell. seconds: stop starting new cases after this much CPU time (45 when quick).
    """
    network, conditions, plan = open_loop()
    limit = seconds if seconds is not None else (40.0 if quick else np.inf)
    start, found = time.process_time(), []
    for case in cases(quick, seeds, strengths, noises, offset):
        if time.process_time() - start > limit:
            break
        entry = _one(case, network, conditions, plan)
        if entry is not None:
            found.append(entry)
            print(json.dumps(entry, default=float), file=sys.stderr, flush=True)
    return {"quick": quick, **score(found)}


def _one(case: Case, network: dict, conditions, plan) -> dict | None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth, redrawn = _hide(case, network, conditions, plan, folder)
        if truth is None:
            return None if not redrawn else {"effect": "+".join(case.effects), "skipped": True, "redrawn": redrawn}
        begin = time.process_time()
        answer = _analyse(folder)
        cpu = time.process_time() - begin
    return {**_scored(case, truth, answer), "redrawn": redrawn, "cpu_s": cpu}


def _analyse(folder: Path) -> Discovery:
    """The analyst's side: reads the three files and nothing else."""
    read = read_conditions(folder / "conditions.yaml")
    model = files.read_json(folder / "model.json")
    problem = read_problem(model, folder / "measurements.csv", read, folder / "conditions.yaml", Settings())
    return discover(problem, seed=1)


def _hide(case: Case, network, conditions, plan, folder) -> tuple[hidden.Truth | None, int]:
    random = generator(case.seed, "discrepancy", "bench", *case.effects, case.outside, case.strength, case.noise)
    anatomy = Anatomy(network, pressure=1e5)
    series = [
        Series(c, quantity, place, statistic, np.zeros(1) if statistic == "waveform" else None, 1.0)
        for c in conditions
        for quantity, place, statistic, _ in plan.entries
    ]
    for draw in range(DRAWS):
        acting, sizes = [], []
        for name in case.effects:
            one = effect(name)
            places = one.places(anatomy, series)
            if not places:
                return None, 0
            acting.append((one, places[int(random.integers(len(places)))]))
            positive, signed = STRENGTHS[case.strength]
            for parameter in one.parameters:
                sign = random.choice((-1.0, 1.0))
                sizes.append(positive if parameter.kind == "lognormal" else sign * signed)
        outside = _outside(case.outside, network) if case.outside else None
        # Noise and nuisance parameters of their own in every cell, so that trials are independent.
        seed = int(random.integers(2**31))
        truth = hidden.hide(
            network, conditions, plan, acting, np.array(sizes), NOISES[case.noise], seed, folder, outside
        )
        if (not acting and not case.outside) or truth.visible >= LEAST_VISIBLE:
            return truth, draw
    return None, DRAWS


def _scored(case: Case, truth: hidden.Truth, answer: Discovery) -> dict:
    problem = answer.problem
    classes = [[(c.effect.name, c.place) for c in entry.members] for entry in answer.named]
    wanted = [(one.name, place) for one, place in truth.acting]
    got = [any(name == e for members in classes for e, _ in members) for name, _ in wanted]
    placed = [any(pair in members for members in classes) for pair in wanted]
    first = classes[0] if classes else []
    entry = {
        "effect": case.outside and f"outside:{case.outside}" or "+".join(case.effects) or "none",
        "places": [place for _, place in wanted],
        "strength": case.strength,
        "noise": case.noise,
        "network": "open_loop",
        "visible": truth.visible,
        "named": bool(wanted) and any(name == wanted[0][0] for name, _ in first) if len(wanted) == 1 else all(got),
        "placed": bool(wanted) and all(placed),
        "alarmed": answer.alarm,
        "abstained": answer.outside_library or (answer.alarm and not classes),
        "first": first[0][0] if first else ("outside" if answer.outside_library else "none"),
        "classes": [["@".join(member) for member in members] for members in classes],
        "before": answer.before.misfit,
        "after": answer.before.misfit if answer.outside_library else answer.after.misfit,
        "flexible": answer.flexible.misfit,
        "remaining": answer.remaining.p,
    }
    rows = len(answer.before.residual)
    entry["held_out_lpd_gain"] = 0.0 if answer.outside_library else answer.after.total_lpd - answer.before.total_lpd
    # The mean square of m whitened residuals varies by sqrt(2 / m) by chance alone.
    entry["worse"] = bool(entry["after"] ** 2 > answer.before.misfit**2 + 2.0 * np.sqrt(2.0 / rows))
    if wanted:
        oracle = problem.calibrate(truth.acting, np.concatenate([np.zeros(problem.count), truth.sizes]))
        best = gap(problem, linearise(problem, oracle.z, truth.acting), answer.folds, 1).misfit
        room = answer.before.misfit**2 - best**2
        entry["oracle"] = best
        entry["gap_closed_over_oracle"] = (
            float((answer.before.misfit**2 - entry["after"] ** 2) / room) if room > 0.1 else None
        )
        entry["covered"] = _covered(answer, truth)
    return entry


def _covered(answer: Discovery, truth: hidden.Truth) -> bool | None:
    """Whether the 90 % interval of the size holds the true one; None where the true effect was not the one added."""
    if len(truth.acting) != 1 or not answer.named:
        return None
    (one, place), size = truth.acting[0], truth.sizes[0]
    for entry in named(answer):
        if (entry["effect"], entry["place"]) == (one.name, place):
            parameter = one.parameters[0]
            low, high = entry["sizes"][parameter.name]["interval_90"]
            return bool(low <= float(parameter.from_standard(size)) <= high)
    return None


def wilson(successes: int, trials: int, z: float = 1.959963984540054) -> dict:
    """Share with its 95 % interval (Wilson 1927)."""
    if trials == 0:
        return {"share": None, "low": None, "high": None, "trials": 0}
    share = successes / trials
    centre = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return {"share": share, "low": float(centre - half), "high": float(centre + half), "trials": trials}


def score(found: list[dict]) -> dict:
    """Cells, totals with Wilson intervals, confusion matrix, from scored cases."""
    skipped = [e for e in found if e.get("skipped")]
    found = [e for e in found if not e.get("skipped")]
    single = [e for e in found if len(e["places"]) == 1]
    double = [e for e in found if len(e["places"]) == 2]
    nothing = [e for e in found if e["effect"] == "none"]
    outside = [e for e in found if e["effect"].startswith("outside:")]
    headline = [e for e in single if e["noise"] == "nominal" and e["strength"] == "medium"]
    covered = [e["covered"] for e in single if e["covered"] is not None]
    closed = [e["gap_closed_over_oracle"] for e in single + double if e["gap_closed_over_oracle"] is not None]

    def share(entries, key):
        return wilson(sum(bool(e[key]) for e in entries), len(entries))

    cells: dict[tuple, list[dict]] = {}
    for e in found:
        cells.setdefault((e["effect"], e["strength"], e["noise"], e["network"]), []).append(e)
    confusion: dict[str, dict[str, int]] = {}
    for e in found:
        row = confusion.setdefault(e["effect"], {})
        row[e["first"]] = row.get(e["first"], 0) + 1
    return {
        "cells": [
            {
                "effect": key[0],
                "strength": key[1],
                "noise": key[2],
                "network": key[3],
                "seeds": len(entries),
                "named": float(np.mean([e["named"] for e in entries])),
                "placed": float(np.mean([e["placed"] for e in entries])),
                "alarmed": float(np.mean([e["alarmed"] for e in entries])),
                "abstained": float(np.mean([e["abstained"] for e in entries])),
                "gap_closed_over_oracle": _mean([e.get("gap_closed_over_oracle") for e in entries]),
            }
            for key, entries in cells.items()
        ],
        "totals": {
            "identification": share(headline, "named"),
            "place": share(headline, "placed"),
            "false_alarm": share(nothing, "alarmed"),
            "abstention": share(outside, "abstained"),
            "both_of_two": share(double, "named"),
            "interval_coverage_90": wilson(sum(covered), len(covered)),
            "gap_closed": float(np.median(closed)) if closed else None,
            "gap_closed_above_90": wilson(sum(c >= 0.9 for c in closed), len(closed)),
            "worse_than_recalibration": share(found, "worse"),
        },
        "confusion": confusion,
        "invisible": {e["effect"]: sum(o["effect"] == e["effect"] for o in skipped) for e in skipped},
        "cpu_s_per_discovery": _mean([e["cpu_s"] for e in found]),
    }


def _mean(values) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None
