"""The search on a table model: which law of pressure loss the simulated outputs lack, branch by branch."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq import files
from coronaryuq.discrepancy.laws import (
    BEYOND,
    FLOOR_FFR,
    LAWS,
    RECALIBRATION,
    choose,
    fit_law,
    fit_laws,
    inclusion,
    predict,
)
from coronaryuq.discrepancy.output import clear
from coronaryuq.discrepancy.tables import Branch, branches, read_pairs
from coronaryuq.seeds import generator
from coronaryuq.zerod.effects.library import effect

FOLDS = 5
LEAST_GAIN = 3.0
"""Log evidence over that of no effect from which there is something to explain."""
LEFT, LEFT_FLEXIBLE, LEFT_FLOORS = 0.1, 3.0, 2.0
"""Held-out error of FFR that what is known may leave: a share of the model's, so many times what a flexible discrepancy
leaves, or so many times `FLOOR_FFR`. Where it leaves more than all three, something else is missing."""
CONSTANT = 1e-9
"""Relative spread of an input below which it is the same in all samples: a prescribed root pressure, say."""
MOST_FLEXIBLE = 120
"""Samples that the reference Gaussian process is fitted to."""


def discover_pairs(simulated: str | Path, measured: str | Path, out: Path, seed: int) -> dict:
    """Search a table model and write `discrepancy.json`, `pairs.csv`, `laws.csv`, `effects.csv`, `paragraph.txt` into
    `out`.

    Laws are chosen and fitted on four folds of the samples and judged on the fifth, for every fold; what is reported
    as named was chosen on all. Gaps are root mean square errors of FFR on held-out samples.
    """
    table0, table3 = read_pairs(simulated, measured)
    found = branches(table0, table3, simulated, measured)
    count = len(table0)
    fold = generator(seed, "discrepancy", "pairs").permutation(np.arange(count) % FOLDS)
    answers, rows, laws = [], [], []
    for branch in found:
        measured_ffr = branch.distal3 / branch.root3
        before = branch.distal0 / branch.root0
        after, plain, flexible = (np.empty(count) for _ in range(3))
        chosen = []
        for k in range(FOLDS):
            train, test = fold != k, fold == k
            best = choose(fit_laws(branch, train))
            chosen.append(best.law.effects)
            after[test] = predict(branch, best.terms)[0][test]
            plain[test] = predict(branch, fit_law(branch, LAWS[0], train).terms)[0][test]
            flexible[test] = _flexible(branch, train, test)
        ranked = fit_laws(branch, np.ones(count, dtype=bool))
        answers.append(_answer(branch, ranked, chosen, measured_ffr, before, plain, after, flexible))
        laws += [
            (branch.name, "+".join(f.law.effects) or "none", "+".join(f.law.terms), f.evidence, f.rms_ffr)
            for f in ranked
        ]
        rows.append(
            pd.DataFrame(
                {
                    "branch": branch.name,
                    "sample": table0.index,
                    "flow": branch.flow3,
                    "drop_measured": branch.drop3,
                    "drop_model_at_flow": branch.drop0 / branch.flow0 * branch.flow3,
                    "ffr_measured": measured_ffr,
                    "ffr_simulated": before,
                    "ffr_recalibrated": plain,
                    "ffr_repaired": after,
                    "ffr_flexible": flexible,
                }
            )
        )
    answer = _joined(answers)
    clear(out)
    files.write_csv(out / "pairs.csv", pd.concat(rows))
    columns = ["branch", "effects", "terms", "log_evidence", "rms_ffr"]
    files.write_csv(out / "laws.csv", pd.DataFrame(laws, columns=columns))
    parts = [
        (a["branch"], name, probability, name in a["effects"])
        for a in answers
        for name, probability in a["inclusion"].items()
    ]
    files.write_csv(out / "effects.csv", pd.DataFrame(parts, columns=["branch", "effect", "probability", "named"]))
    files.write_text(out / "paragraph.txt", answer["paragraph"] + "\n")
    files.write_json(out / "discrepancy.json", answer)
    return answer


def _flexible(branch: Branch, train: np.ndarray, test: np.ndarray) -> np.ndarray:
    """FFR by a Gaussian process on the simulated outputs: a floor for what these pairs can tell."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    inputs = np.column_stack([branch.flow0, branch.distal0 / branch.root0, branch.root0])
    inputs = inputs[:, inputs[train].std(axis=0) > CONSTANT * np.abs(inputs[train]).max(axis=0)]
    inputs = (inputs - inputs[train].mean(axis=0)) / inputs[train].std(axis=0)
    target = branch.distal3 / branch.root3
    kernel = ConstantKernel(10.0, (1e-2, 1e8)) * RBF(np.full(inputs.shape[1], 5.0), (1e-1, 1e3)) + WhiteKernel(
        1e-3, (1e-10, 1.0)
    )
    process = GaussianProcessRegressor(kernel, normalize_y=True)
    some = np.flatnonzero(train)[:MOST_FLEXIBLE]
    with warnings.catch_warnings():
        # A bound reached or an optimiser stopped early only makes the reference a little worse.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(inputs[some], target[some])
    return process.predict(inputs[test])


def _answer(branch, ranked, chosen, measured_ffr, before, plain, after, flexible) -> dict:
    def rmse(values):
        return float(np.sqrt(np.mean((values - measured_ffr) ** 2)))

    best, none = choose(ranked), next(f for f in ranked if not f.law.terms)
    first, probabilities = best.law.effects, inclusion(ranked)
    alarm = ranked[0].evidence - none.evidence > LEAST_GAIN
    left = {
        "before": rmse(before),
        "recalibration_alone": rmse(plain),
        "after": rmse(after),
        "flexible": rmse(flexible),
    }
    explained = left["after"] < max(LEFT * left["before"], LEFT_FLEXIBLE * left["flexible"], LEFT_FLOORS * FLOOR_FFR)
    outside = bool(not explained or (alarm and first and left["after"] >= left["recalibration_alone"]))
    rivals = [name for name, p in probabilities.items() if p > 0.05 and name not in first]
    return {
        "branch": branch.name,
        "place": branch.place,
        "segment": f"root to {branch.place}",
        "flow": branch.flow_source,
        "alarm": bool(alarm or outside),
        "effects": list(first) if alarm and not outside else [],
        "outside_library": outside,
        "probability": min((probabilities[name] for name in first), default=0.0),
        "inclusion": probabilities,
        "class": list(first),
        "possibly_also": rivals,
        "coefficients": {name: best.terms[name] for name in best.law.terms},
        "recalibration": {name: best.terms[name] for name in (*RECALIBRATION, BEYOND)},
        "share_of_folds_with_this_name": float(np.mean([c == first for c in chosen])),
        "drop": {
            "measured": float(branch.drop3.mean()),
            "simulated": float(branch.drop0.mean()),
            "ffr_rms_left": best.rms_ffr,
        },
        "ffr": {
            "measured": float(measured_ffr.mean()),
            "simulated": float(before.mean()),
            "repaired": float(after.mean()),
        },
        "ffr_rmse": left,
    }


def _joined(answers: list[dict]) -> dict:
    def together(key):
        return float(np.sqrt(np.mean([a["ffr_rmse"][key] ** 2 for a in answers])))

    named = [
        {
            "effect": name,
            "place": a["place"],
            "branch": a["branch"],
            "probability": a["inclusion"][name],
            "class": [{"effect": name, "place": a["place"], "probability": a["inclusion"][name]}],
            "possibly_also": a["possibly_also"],
            "coefficients": a["coefficients"],
            "formula": effect(name).formula,
            "source": effect(name).source,
        }
        for a in answers
        for name in a["effects"]
    ]
    text = ""
    for a in answers:
        left = (
            f"On held-out samples the error of FFR falls from {a['ffr_rmse']['before']:.4f} "
            f"to {a['ffr_rmse']['after']:.4f} (recalibration alone {a['ffr_rmse']['recalibration_alone']:.4f}, "
            f"a Gaussian process {a['ffr_rmse']['flexible']:.4f}). "
        )
        drops = (
            f"{a['branch'].upper()}: the drop of pressure to {a['place']} is {a['drop']['measured']:.1f} measured and "
            f"{a['drop']['simulated']:.1f} simulated"
        )
        if a["outside_library"]:
            nearest = " and ".join(a["class"] or ["recalibration"]).replace("_", " ")
            text += (
                f"{drops}, and no law of loss explains it: what comes nearest, {nearest}, "
                f"leaves too much, and nothing is named. With it, {left[0].lower()}{left[1:]}"
            )
            continue
        if a["alarm"] and not a["effects"]:
            rivals = " or ".join(a["possibly_also"]).replace("_", " ")
            text += f"{drops}; something is missing, and the samples do not tell which: {rivals}. {left}"
            continue
        if not a["effects"]:
            text += f"{a['branch'].upper()}: simulated and measured drops agree; nothing to explain. "
            continue
        text += (
            f"{drops}; missing is {' and '.join(a['effects']).replace('_', ' ')} "
            f"(probability {a['probability']:.2f}, chosen in {a['share_of_folds_with_this_name']:.0%} of the folds). "
            f"{left}"
        )
    return {
        "alarm": any(a["alarm"] for a in answers),
        "located": [{"branch": a["branch"], "segment": a["segment"], **a["drop"]} for a in answers if a["alarm"]],
        "named": named,
        "outside_library": any(a["outside_library"] for a in answers),
        "gap_before": together("before"),
        "gap_after": together("after"),
        "gap_recalibrated": together("recalibration_alone"),
        "noise_floor": together("flexible"),
        "gap_unit": "root mean square error of FFR on held-out samples",
        "held_out": {"samples": f"{FOLDS} folds", "branches": answers},
        "paragraph": text.strip(),
    }
