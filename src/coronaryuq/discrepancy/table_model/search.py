"""Search on a table model: find the pressure-loss law that the simulated outputs are missing, branch by branch."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.result.write import clear
from coronaryuq.discrepancy.table_model.branch_search import FOLDS, BranchSearch, search_branch
from coronaryuq.discrepancy.table_model.law_selection import Choice, inclusion, is_one_of
from coronaryuq.discrepancy.table_model.laws import BEYOND, RECALIBRATION, SENSORS, Size, sizes
from coronaryuq.discrepancy.table_model.prediction import predictions, table_of_predictions
from coronaryuq.discrepancy.table_model.summary_text import branch_text
from coronaryuq.discrepancy.table_model.tables import Branch, branches, read_pairs
from coronaryuq.zerod.effects.library import effect

UNITS = {
    "linear": "pressure unit of the tables / flow unit",
    "quadratic": "pressure unit of the tables / flow unit squared",
    "offset": "pressure unit of the tables",
    "gain": "",
    "flow": "",
}
LEAST_POSSIBLE = 0.05
"""Probability above which an effect that is not named may still be present."""


@threadpool_limits.wrap(limits=1)
def discover_pairs(simulated: str | Path, measured: str | Path, out_dir: Path, seed: int) -> dict:
    """Search a table model and write the results into `out_dir`.

    Laws are selected and fitted on four folds of the samples and tested on the fifth, for every fold; the effects
    reported as named are selected on all samples. Gaps are root mean square errors of FFR on held-out samples.

    Parameters
    ----------
    simulated, measured
        CSV tables, joined on the column `sample`.
    out_dir
        Folder for `discrepancy.json`, `pairs.csv`, `laws.csv`, `effects.csv`, `predicted.csv` and `paragraph.txt`.
    seed
        Seed of the folds.

    Returns
    -------
    dict
        Content of `discrepancy.json`.

    Raises
    ------
    InputError
        If a table is invalid, before anything is written.
    """
    table0, table3 = read_pairs(simulated, measured)
    fold = generator(seed, "discrepancy", "pairs").permutation(np.arange(len(table0)) % FOLDS)
    found = branches(table0, table3, simulated, measured)
    searches = [search_branch(branch, fold, [other for other in found if other is not branch]) for branch in found]
    answers = [_answer(search) for search in searches]
    summary = _summary(answers)
    clear(out_dir)
    write_csv(out_dir / "pairs.csv", pd.concat([_samples(search, table0.index) for search in searches]))
    write_csv(out_dir / "laws.csv", pd.DataFrame([row for search in searches for row in _laws(search)]))
    write_csv(out_dir / "effects.csv", pd.DataFrame([row for answer in answers for row in _effects(answer)]))
    predicted = [row for answer in answers for row in table_of_predictions(answer["branch"], answer["prediction"])]
    write_csv(out_dir / "predicted.csv", pd.DataFrame(predicted))
    write_text(out_dir / "paragraph.txt", summary["paragraph"] + "\n")
    write_json(out_dir / "discrepancy.json", summary)
    return summary


def _samples(search: BranchSearch, samples: pd.Index) -> pd.DataFrame:
    branch = search.branch
    return pd.DataFrame(
        {
            "branch": branch.name,
            "sample": samples,
            "flow": branch.flow3,
            "drop_measured": branch.drop3,
            "drop_model_at_flow": branch.drop0 / branch.flow0 * branch.flow3,
            "ffr_measured": search.measured,
            "ffr_simulated": search.before,
            "ffr_recalibrated": search.plain,
            "ffr_repaired": search.after,
            "ffr_flexible": search.flexible,
        }
    )


def _laws(search: BranchSearch) -> list[dict]:
    return [
        {
            "branch": search.branch.name,
            "effects": "+".join(fit.law.effects) or "none",
            "terms": "+".join(fit.law.terms),
            "log_evidence": fit.evidence,
            "rms_ffr": fit.rms_ffr,
        }
        for fit in search.ranked
    ]


def _effects(answer: dict) -> list[dict]:
    unknown = dict.fromkeys(("size", "size_low", "size_high"), np.nan)
    return [
        {"branch": answer["branch"], "effect": name, "probability": probability, "named": name in answer["effects"]}
        | {key: answer["sizes"].get(name, unknown)[key] for key in unknown}
        for name, probability in answer["inclusion"].items()
    ]


def _answer(search: BranchSearch) -> dict:
    """Return the result of one branch, as in `discrepancy.json`."""
    branch, alarm = search.branch, search.alarm or search.outside
    choice = search.choice if alarm else Choice(search.recalibrated, ())
    best, probabilities = choice.fit, inclusion(search.ranked)
    effects = best.law.effects
    classes = dict(zip(effects, choice.classes, strict=True))
    members = [name for c in choice.classes for name in c.members]
    every = np.ones(len(branch.flow0), dtype=bool)
    intervals = {name: _size(size) for name, size in sizes(branch, best, every).items()}
    named = search.alarm and not search.outside
    return {
        "branch": branch.name,
        "place": branch.place,
        "distal_pressure": f"mean_pressure:{branch.place}",
        "segment": f"root to {branch.place}",
        "flow": branch.flow_source,
        "alarm": bool(alarm),
        "effects": list(effects) if named else [],
        "outside_library": search.outside,
        "overstated": search.overstated,
        "doubt": bool(search.doubt),
        "probability": min((c.probability for c in classes.values()), default=0.0),
        "inclusion": probabilities,
        "class": members,
        "classes": {name: {m: probabilities[m] for m in c.members} for name, c in classes.items()},
        "class_probability": {name: c.probability for name, c in classes.items()},
        "possibly_also": [name for name, p in probabilities.items() if p > LEAST_POSSIBLE and name not in members],
        "coefficients": {name: best.terms[name] for name in best.law.terms},
        "terms": [{"term": n, "unit": UNITS[n], **intervals[n]} for n in best.law.terms] if named else [],
        "sizes": {name: {"of": _reference(name), **intervals[name]} for name in effects} if named else {},
        "recalibration": {name: best.terms[name] for name in (*RECALIBRATION, BEYOND)},
        "own_loss_shift": best.own,
        "rank_correlation": _rank_correlation(branch),
        "share_of_folds_with_this_name": float(
            np.mean([is_one_of(e, [c.members for c in choice.classes]) for e in search.in_folds])
        ),
        "drop": {
            "measured": float(branch.drop3.mean()),
            "simulated": float(branch.drop0.mean()),
            "ffr_rms_left": best.rms_ffr,
        },
        "ffr": {
            "measured": float(search.measured.mean()),
            "simulated": float(search.before.mean()),
            "repaired": float(search.after.mean()),
        },
        "prediction": predictions(search),
        "ffr_rmse": {
            "before": search.rmse(search.before),
            "recalibration_alone": search.rmse(search.plain),
            "after": search.rmse(search.after),
            "flexible": search.rmse(search.flexible),
        },
    }


def _size(size: Size) -> dict[str, float]:
    return {"size": size.value, "size_low": size.low, "size_high": size.high}


def _reference(effect_name: str) -> str:
    """Name the quantity of which the size of an effect is a fraction."""
    if effect_name not in SENSORS:
        return "the mean root pressure lost at the mean simulated flow"
    return "the mean root pressure" if SENSORS[effect_name] == "offset" else "the reading"


def _rank_correlation(branch: Branch) -> float:
    """Largest rank correlation over the samples of quantities in both tables: pressures, flow and drop."""
    both = [
        (branch.root0, branch.root3),
        (branch.distal0, branch.distal3),
        (branch.outlet0, branch.outlet3),
        (branch.flow0, branch.flow3),
        (branch.drop0, branch.drop3),
    ]
    return max(float(spearmanr(a, b).statistic) if np.ptp(a) > 0.0 < np.ptp(b) else -1.0 for a, b in both)


def _summary(answers: list[dict]) -> dict:
    """Content of `discrepancy.json`."""

    def over_branches(key: str) -> float:
        return float(np.sqrt(np.mean([a["ffr_rmse"][key] ** 2 for a in answers])))

    named = [
        {
            "effect": name,
            "place": a["place"],
            "branch": a["branch"],
            "probability": a["class_probability"][name],
            "class": [{"effect": m, "place": a["place"], "probability": p} for m, p in a["classes"][name].items()],
            "possibly_also": a["possibly_also"],
            "coefficients": a["coefficients"],
            "terms": a["terms"],
            "size": a["sizes"][name],
            "formula": effect(name).formula,
            "signature": effect(name).signature,
            "source": effect(name).source,
        }
        for a in answers
        for name in a["effects"]
    ]
    return {
        "alarm": any(a["alarm"] for a in answers),
        "located": [{"branch": a["branch"], "segment": a["segment"], **a["drop"]} for a in answers if a["alarm"]],
        "named": named,
        "outside_library": any(a["outside_library"] for a in answers),
        "gap_before": over_branches("before"),
        "gap_after": over_branches("after"),
        "gap_recalibrated": over_branches("recalibration_alone"),
        "expected_misfit": over_branches("flexible"),
        "gap_unit": "root mean square error of FFR on held-out samples",
        "held_out": {"samples": f"{FOLDS} folds", "branches": answers},
        "paragraph": " ".join(branch_text(a) for a in answers),
    }
