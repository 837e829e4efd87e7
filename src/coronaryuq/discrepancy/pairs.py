"""The search on a table model: which law of pressure loss the simulated outputs lack, branch by branch."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from coronaryuq import files
from coronaryuq.discrepancy.tables import Branch, branches, read_pairs
from coronaryuq.seeds import generator
from coronaryuq.zerod.effects.library import effect

FOLDS = 5
LEAST_GAIN, LEAST_INCLUSION = 3.0, 0.9
MOST_FLEXIBLE = 120
"""Samples that the reference Gaussian process is fitted to."""
SD_RECALIBRATION = 0.25
"""Prior standard deviation of the logarithms of bed resistance and of the model's own loss: recalibration."""
SD_OFFSET, SD_GAIN = 0.05, 0.05
"""Prior standard deviations of a sensor's offset over the root's pressure, and of its gain."""
FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET = 0.003, 0.02, 0.01
"""Errors (FFR, relative flow, outlet over root pressure) below which lumped losses are not to be believed."""
SD_LOSS, MEDIAN_LOSS, MEDIAN_BEYOND = 1.2, 0.1, 0.01
"""Log-normal prior of a loss over the root's pressure at the simulated flow, as in the library of effects."""


@dataclass(frozen=True)
class Law:
    """Named effects and the terms that they bring into one branch's circuit."""

    effects: tuple[str, ...]
    terms: tuple[str, ...]


LAWS = (
    Law((), ()),
    Law(("quadratic_stenosis",), ("quadratic",)),
    Law(("quadratic_stenosis",), ("linear", "quadratic")),
    Law(("diffuse_narrowing",), ("linear",)),
    Law(("pressure_offset",), ("offset",)),
    Law(("pressure_gain",), ("gain",)),
    Law(("flow_gain",), ("flow",)),
    Law(("diffuse_narrowing", "pressure_offset"), ("linear", "offset")),
    Law(("quadratic_stenosis", "pressure_offset"), ("quadratic", "offset")),
    Law(("diffuse_narrowing", "pressure_gain"), ("linear", "gain")),
    Law(("quadratic_stenosis", "pressure_gain"), ("quadratic", "gain")),
)
"""A stenosis may bring its throat's viscous loss, linear in flow, beside the quadratic one (Young & Tsai 1973)."""
LOSSES = ("linear", "quadratic")
RECALIBRATION = ("bed", "own")
BEYOND = "beyond"
"""Loss behind the place where the distal pressure is taken: it lowers flow but is no part of the drop to that place."""
SLOPE_STEP = float(np.sqrt(np.finfo(float).eps))
MOST_EFFECTIVE = 100
"""Samples that count at most: the error of one law is common to all samples and does not average out over them."""


@dataclass(frozen=True)
class LawFit:
    """Most probable terms of one law; evidence: Schwarz's approximation to the log marginal likelihood."""

    law: Law
    terms: dict[str, float]
    evidence: float
    rms_ffr: float


def predict(branch: Branch, terms: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """FFR, flow and outlet pressure over root pressure, (n,) each, of every sample from simulated outputs alone.

    terms: numbers, or (m, 1) each for m sets side by side, which gives (m, n).

    Solves P_root = z + (own D_0/Q_0 + R + R_end + bed R_bed) Q + S Q^2 per sample: D_0 the simulated drop to the distal
    place, R_end the resistance from there to the outlet (the simulated one and what lies beyond), R_bed the bed's,
    (P_outlet - z) / Q_0, z the zero-flow pressure. A sensor's offset and gain act on the distal
    pressure and the flow that are read.
    """
    bed = terms.get("bed", 1.0) * (branch.outlet0 - branch.venous) / branch.flow0
    end = (branch.distal0 - branch.outlet0) / branch.flow0 + terms.get(BEYOND, 0.0)
    series = terms.get("own", 1.0) * branch.drop0 / branch.flow0 + terms.get("linear", 0.0) + end + bed
    root = branch.root0 * float(np.mean(branch.root3) / np.mean(branch.root0))
    quadratic, head = terms.get("quadratic", 0.0), root - branch.venous
    # The form without cancellation for a small quadratic loss.
    flow = 2.0 * head / (series + np.sqrt(series**2 + 4.0 * quadratic * head))
    outlet = branch.venous + bed * flow
    distal = outlet + end * flow
    read = distal * (1.0 + terms.get("gain", 0.0)) + terms.get("offset", 0.0)
    return read / root, flow * (1.0 + terms.get("flow", 0.0)), outlet / root


def fit_law(branch: Branch, law: Law, rows: np.ndarray) -> LawFit:
    """Most probable terms on chosen samples, the noise of each output unknown, profiled out above its floor.

    Objective: n/2 (log s^2 + mean square / s^2) of FFR, flow and outlet pressure, and the priors, n at most
    `MOST_EFFECTIVE`; k/2 log n per term of the law and log 10 per effect are taken off for the evidence.
    """
    ffr, count = branch.distal3 / branch.root3, int(rows.sum())
    names = [*RECALIBRATION, BEYOND, *law.terms]
    weight = min(count, MOST_EFFECTIVE)
    scale = {
        "linear": branch.root0.mean() / branch.flow0.mean(),
        "quadratic": branch.root0.mean() / branch.flow0.mean() ** 2,
        BEYOND: branch.root0.mean() / branch.flow0.mean(),
        "offset": SD_OFFSET * branch.root0.mean(),
        "gain": SD_GAIN,
        "flow": SD_GAIN,
    }

    def terms(z):
        found = {}
        for name, value in zip(names, z, strict=True):
            if name in RECALIBRATION:
                found[name] = np.exp(SD_RECALIBRATION * value)
            elif name == BEYOND:
                found[name] = scale[name] * MEDIAN_BEYOND * np.exp(SD_LOSS * value)
            elif name in LOSSES:
                found[name] = scale[name] * MEDIAN_LOSS * np.exp(SD_LOSS * value)
            else:
                found[name] = scale[name] * value
        return found

    def objectives(points):
        """At points (m, k) in one go, (m,)."""
        predicted, flow, outlet = predict(branch, terms(points.T[:, :, None]))
        misfit = np.zeros(len(points))
        errors = (predicted - ffr, flow / branch.flow3 - 1.0, outlet - branch.outlet3 / branch.root3)
        for error, floor in zip(errors, (FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET), strict=True):
            variance = np.mean(error[:, rows] ** 2, axis=1)
            sd2 = np.maximum(variance, floor**2)
            misfit += 0.5 * weight * (np.log(sd2) + variance / sd2)
        return misfit + 0.5 * np.sum(points**2, axis=1)

    def with_slope(z):
        steps = SLOPE_STEP * np.maximum(1.0, np.abs(z))
        found = objectives(np.vstack([z, z + np.diag(steps)]))
        return found[0], (found[1:] - found[0]) / steps

    starts = [np.zeros(len(names))] + [
        np.r_[0.0, 0.0, 0.0, np.full(len(law.terms), k)] for k in (-1.0, 1.0) if law.terms
    ]
    found = [minimize(with_slope, start, method="BFGS", jac=True) for start in starts]
    best = min(found, key=lambda one: one.fun)
    chosen = {name: float(value) for name, value in terms(best.x).items()}
    rms = float(np.sqrt(np.mean((predict(branch, chosen)[0] - ffr)[rows] ** 2)))
    evidence = -float(best.fun) - 0.5 * len(law.terms) * np.log(weight) - len(law.effects) * np.log(10.0)
    return LawFit(law, chosen, evidence, rms)


def fit_laws(branch: Branch, rows: np.ndarray) -> list[LawFit]:
    """All laws on chosen samples (n,) bool, best first."""
    return sorted((fit_law(branch, law, rows) for law in LAWS), key=lambda fit: -fit.evidence)


def inclusion(ranked: list[LawFit]) -> dict[str, float]:
    """Posterior probability that each effect is part of the law, over all laws."""
    weights = np.exp([fit.evidence - ranked[0].evidence for fit in ranked])
    weights /= weights.sum()
    names = dict.fromkeys(name for fit in ranked for name in fit.law.effects)
    return {
        name: float(sum(w for w, fit in zip(weights, ranked, strict=True) if name in fit.law.effects)) for name in names
    }


def choose(ranked: list[LawFit]) -> LawFit:
    """The best law of exactly those effects that are part of it with probability `LEAST_INCLUSION` at least."""
    chosen = {name for name, probability in inclusion(ranked).items() if probability >= LEAST_INCLUSION}
    return next((fit for fit in ranked if set(fit.law.effects) == chosen), ranked[0])


def discover_pairs(simulated: str | Path, measured: str | Path, out: Path, seed: int) -> dict:
    """Search a table model and write `discrepancy.json`, `pairs.csv`, `laws.csv`, `effects.csv`, `paragraph.txt` into
    `out`.

    Laws are chosen and fitted on four folds of the samples and judged on the fifth, for every fold; what is reported
    as named was chosen on all. Gaps are root mean square errors of FFR on held-out samples.
    """
    table0, table3 = read_pairs(simulated, measured)
    found = branches(table0, table3, simulated)
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
    inputs = (inputs - inputs[train].mean(axis=0)) / inputs[train].std(axis=0)
    target = branch.distal3 / branch.root3
    kernel = ConstantKernel(10.0, (1e-2, 1e8)) * RBF(np.full(3, 5.0), (1e-1, 1e3)) + WhiteKernel(1e-3, (1e-10, 1.0))
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
    rivals = [name for name, p in probabilities.items() if p > 0.05 and name not in first]
    return {
        "branch": branch.name,
        "place": branch.place,
        "segment": f"root to {branch.place}",
        "flow": branch.flow_source,
        "alarm": bool(alarm),
        "effects": list(first) if alarm else [],
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
        "ffr_rmse": {
            "before": rmse(before),
            "recalibration_alone": rmse(plain),
            "after": rmse(after),
            "flexible": rmse(flexible),
        },
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
        if not a["effects"]:
            text += f"{a['branch'].upper()}: simulated and measured drops agree; nothing to explain. "
            continue
        text += (
            f"{a['branch'].upper()}: the drop of pressure to {a['place']} is {a['drop']['measured']:.1f} measured and "
            f"{a['drop']['simulated']:.1f} simulated; missing is {' and '.join(a['effects']).replace('_', ' ')} "
            f"(probability {a['probability']:.2f}, chosen in {a['share_of_folds_with_this_name']:.0%} of the folds). "
            f"On held-out samples the error of FFR falls from {a['ffr_rmse']['before']:.4f} "
            f"to {a['ffr_rmse']['after']:.4f} (recalibration alone {a['ffr_rmse']['recalibration_alone']:.4f}, "
            f"a Gaussian process {a['ffr_rmse']['flexible']:.4f}). "
        )
    return {
        "alarm": any(a["alarm"] for a in answers),
        "located": [{"branch": a["branch"], "segment": a["segment"], **a["drop"]} for a in answers if a["alarm"]],
        "named": named,
        "outside_library": False,
        "gap_before": together("before"),
        "gap_after": together("after"),
        "gap_recalibrated": together("recalibration_alone"),
        "noise_floor": together("flexible"),
        "gap_unit": "root mean square error of FFR on held-out samples",
        "held_out": {"samples": f"{FOLDS} folds", "branches": answers},
        "paragraph": text.strip(),
    }
