"""The search on a table model: which law of pressure loss the simulated outputs lack, branch by branch."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.result.write import clear
from coronaryuq.discrepancy.table_model.law_selection import SHRUNK, Choice, choose, inclusion, is_one_of
from coronaryuq.discrepancy.table_model.laws import (
    BEYOND,
    FLOOR_FFR,
    LAWS,
    ONE_EFFECT,
    RECALIBRATION,
    SENSORS,
    LawFit,
    Size,
    fit_law,
    fit_laws,
    predict,
    sizes,
)
from coronaryuq.discrepancy.table_model.tables import Branch, artery, branches, read_pairs
from coronaryuq.zerod.effects.library import effect

FOLDS = 5
LEAST_GAIN = 3.0
"""Log evidence over that of no effect from which there is something to explain."""
LEFT, LEFT_FLEXIBLE, LEFT_FLOORS = 0.1, 3.0, 2.0
"""Held-out error of FFR that what is known may leave: a share of the model's, so many times what a flexible discrepancy
leaves, or so many times `FLOOR_FFR`. Where it leaves more than all three, something else is missing."""
WORSE = 2.0
"""Standard errors, of the paired difference of squares over held-out samples, by which a law that is no better than
recalibration has to be worse to be refuted: stretching the model's own loss is a linear loss as well, and ties."""
STRETCHED = 2.0
"""Prior standard deviations by which recalibration may change the model's own loss before the answer says so."""
AS_WELL = 0.95
"""Share of recalibration's held-out error of FFR above which a law does no better."""
TOGETHER = 0.3
"""Rank correlation of the two tables, the largest of what both have, below which rows are hardly the same samples."""
UNITS = {
    "linear": "pressure unit of the tables / flow unit",
    "quadratic": "pressure unit of the tables / flow unit squared",
    "offset": "pressure unit of the tables",
    "gain": "",
    "flow": "",
}
CONSTANT = 1e-9
"""Relative spread of an input below which it is the same in all samples: a prescribed root pressure, say."""
MOST_FLEXIBLE = 120
"""Samples that the reference Gaussian process is fitted to."""


@threadpool_limits.wrap(limits=1)
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
        before = branch.distal0 / branch.root0
        flexible = np.empty(count)
        for k in range(FOLDS):
            flexible[fold == k] = _flexible(branch, fold != k, fold == k)
        one = _examined(branch, fold, before, flexible, LAWS)
        if one.doubt and len(one.choice.fit.law.effects) > 1:
            # Beside a loss of another form a sensor's error takes up what that form misses.
            one = _examined(branch, fold, before, flexible, ONE_EFFECT)
        answers.append(_answer(branch, one))
        laws += [
            (branch.name, "+".join(f.law.effects) or "none", "+".join(f.law.terms), f.evidence, f.rms_ffr)
            for f in one.ranked
        ]
        rows.append(
            pd.DataFrame(
                {
                    "branch": branch.name,
                    "sample": table0.index,
                    "flow": branch.flow3,
                    "drop_measured": branch.drop3,
                    "drop_model_at_flow": branch.drop0 / branch.flow0 * branch.flow3,
                    "ffr_measured": one.measured,
                    "ffr_simulated": before,
                    "ffr_recalibrated": one.plain,
                    "ffr_repaired": one.after,
                    "ffr_flexible": flexible,
                }
            )
        )
    answer = _joined(answers)
    clear(out)
    write_csv(out / "pairs.csv", pd.concat(rows))
    columns = ["branch", "effects", "terms", "log_evidence", "rms_ffr"]
    write_csv(out / "laws.csv", pd.DataFrame(laws, columns=columns))
    nothing = dict.fromkeys(("size", "size_low", "size_high"), np.nan)
    parts = [
        {"branch": a["branch"], "effect": name, "probability": probability, "named": name in a["effects"]}
        | {key: a["sizes"].get(name, nothing)[key] for key in nothing}
        for a in answers
        for name, probability in a["inclusion"].items()
    ]
    write_csv(out / "effects.csv", pd.DataFrame(parts))
    write_text(out / "paragraph.txt", answer["paragraph"] + "\n")
    write_json(out / "discrepancy.json", answer)
    return answer


def _flexible(branch: Branch, train: np.ndarray, test: np.ndarray) -> np.ndarray:
    """FFR by a Gaussian process on the simulated outputs: a floor for what these pairs can tell."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    inputs = np.column_stack([branch.flow0, branch.distal0 / branch.root0, branch.root0])
    inputs = inputs[:, inputs[train].std(axis=0) > CONSTANT * np.abs(inputs[train]).max(axis=0)]
    target = branch.distal3 / branch.root3
    if inputs.shape[1] == 0:
        return np.full(int(test.sum()), target[train].mean())
    inputs = (inputs - inputs[train].mean(axis=0)) / inputs[train].std(axis=0)
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


@dataclass(frozen=True)
class _Examined:
    """Laws fitted to one branch, what was chosen of them on all samples and in each fold, and held-out FFR, (n,)."""

    ranked: list[LawFit]
    choice: Choice
    in_folds: list[tuple[str, ...]]
    measured: np.ndarray
    before: np.ndarray
    plain: np.ndarray
    after: np.ndarray
    flexible: np.ndarray

    def rmse(self, values: np.ndarray) -> float:
        return float(np.sqrt(np.mean((values - self.measured) ** 2)))

    @property
    def alone(self) -> LawFit:
        """Recalibration without any effect."""
        return next(f for f in self.ranked if not f.law.terms)

    @property
    def alarm(self) -> bool:
        """That a law is likelier, or recalibration has to stretch the model's own loss as far as none does."""
        return self.ranked[0].evidence - self.alone.evidence > LEAST_GAIN or self.alone.own > -SHRUNK

    @property
    def misfits(self) -> bool:
        """That a Gaussian process predicts clearly better, beyond what lumped losses are believed to."""
        left = self.rmse(self.after)
        return left >= max(LEFT_FLEXIBLE * self.rmse(self.flexible), LEFT_FLOORS * FLOOR_FFR)

    @property
    def overstated(self) -> bool:
        """That what is measured has little of the loss that the model has: it lacks nothing, it has too much."""
        return self.choice.fit.own < SHRUNK and self.measured.mean() > self.before.mean()

    @property
    def outside(self) -> bool:
        """That the law leaves too much, or predicts held-out samples worse than recalibration by `WORSE` sd errors, or
        needs a model without its own loss."""
        if self.overstated:
            return True
        if self.misfits and self.rmse(self.after) >= LEFT * self.rmse(self.before):
            return True
        worse = (self.after - self.measured) ** 2 - (self.plain - self.measured) ** 2
        error = worse.std(ddof=1) / np.sqrt(len(worse))
        return bool(self.alarm and self.choice.classes and worse.mean() > WORSE * error)

    @property
    def doubt(self) -> bool:
        """That a law is named although its form is visibly wrong."""
        return self.misfits and self.alarm and not self.outside


def _examined(branch: Branch, fold: np.ndarray, before, flexible, laws) -> _Examined:
    after, plain = np.empty(len(fold)), np.empty(len(fold))
    in_folds = []
    for k in range(FOLDS):
        train, test = fold != k, fold == k
        best = choose(fit_laws(branch, train, laws)).fit
        in_folds.append(best.law.effects)
        after[test] = predict(branch, best.terms)[0][test]
        plain[test] = predict(branch, fit_law(branch, LAWS[0], train).terms)[0][test]
    ranked = fit_laws(branch, np.ones(len(fold), dtype=bool), laws)
    measured = branch.distal3 / branch.root3
    return _Examined(ranked, choose(ranked), in_folds, measured, before, plain, after, flexible)


def _answer(branch: Branch, one: _Examined) -> dict:
    answered = one.choice if one.alarm or one.outside else Choice(one.alone, ())
    best, probabilities = answered.fit, inclusion(one.ranked)
    effects = best.law.effects
    classes = dict(zip(effects, answered.classes, strict=True))
    members = [name for c in answered.classes for name in c.members]
    every = np.ones(len(branch.flow0), dtype=bool)
    found = {name: _size(size) for name, size in sizes(branch, best, every).items()}
    name_it = one.alarm and not one.outside
    return {
        "branch": branch.name,
        "place": branch.place,
        "distal_pressure": f"mean_pressure:{branch.place}",
        "segment": f"root to {branch.place}",
        "flow": branch.flow_source,
        "alarm": bool(one.alarm or one.outside),
        "effects": list(effects) if name_it else [],
        "outside_library": one.outside,
        "overstated": one.overstated,
        "doubt": bool(one.doubt),
        "probability": min((c.probability for c in classes.values()), default=0.0),
        "inclusion": probabilities,
        "class": members,
        "classes": {name: {m: probabilities[m] for m in c.members} for name, c in classes.items()},
        "class_probability": {name: c.probability for name, c in classes.items()},
        "possibly_also": [name for name, p in probabilities.items() if p > 0.05 and name not in members],
        "coefficients": {name: best.terms[name] for name in best.law.terms},
        "terms": [{"term": n, "unit": UNITS[n], **found[n]} for n in best.law.terms] if name_it else [],
        "sizes": {name: {"of": _meaning(name), **found[name]} for name in effects} if name_it else {},
        "recalibration": {name: best.terms[name] for name in (*RECALIBRATION, BEYOND)},
        "own_loss_moved": best.own,
        "goes_together": _together(branch),
        "share_of_folds_with_this_name": float(
            np.mean([is_one_of(e, [c.members for c in answered.classes]) for e in one.in_folds])
        ),
        "drop": {
            "measured": float(branch.drop3.mean()),
            "simulated": float(branch.drop0.mean()),
            "ffr_rms_left": best.rms_ffr,
        },
        "ffr": {
            "measured": float(one.measured.mean()),
            "simulated": float(one.before.mean()),
            "repaired": float(one.after.mean()),
        },
        "ffr_rmse": {
            "before": one.rmse(one.before),
            "recalibration_alone": one.rmse(one.plain),
            "after": one.rmse(one.after),
            "flexible": one.rmse(one.flexible),
        },
    }


def _size(size: Size) -> dict[str, float]:
    return {"size": size.value, "size_low": size.low, "size_high": size.high}


def _meaning(effect_name: str) -> str:
    if effect_name not in SENSORS:
        return "the root's mean pressure lost at the mean simulated flow"
    return "the root's mean pressure" if SENSORS[effect_name] == "offset" else "what is read"


def _joined(answers: list[dict]) -> dict:
    def together(key):
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
            "looks_like": effect(name).signature,
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
        "gap_before": together("before"),
        "gap_after": together("after"),
        "gap_recalibrated": together("recalibration_alone"),
        "noise_floor": together("flexible"),
        "gap_unit": "root mean square error of FFR on held-out samples",
        "held_out": {"samples": f"{FOLDS} folds", "branches": answers},
        "paragraph": " ".join(_words(a) for a in answers),
    }


def _words(a: dict) -> str:
    """What is said of one branch."""
    left = a["ffr_rmse"]
    old, new = (f"{left[key]:.4f}" for key in ("before", "after"))
    went = f"stays at {new}" if old == new else f"{'falls' if new < old else 'rises'} from {old} to {new}"
    others = f"recalibration alone {left['recalibration_alone']:.4f}, a Gaussian process {left['flexible']:.4f}"
    error = f"n held-out samples the error of FFR {went} ({others})."
    drops = (
        f"{artery(a['branch'])}: the drop of pressure to {a['place']} is {a['drop']['measured']:.1f} measured and "
        f"{a['drop']['simulated']:.1f} simulated"
    )
    own = f"multiplies the model's own loss by {a['recalibration']['own']:.2g}"
    if a["overstated"]:
        return (
            f"{drops}, and recalibration {own}, {a['own_loss_moved']:+.1f} standard deviations of its prior. The model "
            "seems to have a loss that is not there, or too strong a one, or the two tables are exchanged; nothing is "
            f"named. With that, o{error}"
        )
    if a["outside_library"]:
        nearest = _listed(list(a["classes"]) or ["recalibration"], " and ")
        return (
            f"{drops}, and no law of loss explains it: what comes nearest, {nearest}, {_short(left)}, and nothing is "
            f"named. With it, o{error}"
        )
    if a["alarm"] and not a["effects"]:
        rivals = _listed(a["possibly_also"], " or ")
        which = f": {rivals}" if rivals else ""
        told = f"something differs, and the samples do not tell what{which}. Recalibration {own}"
        return f"{drops}; {told}. O{error}"
    if not a["effects"] and left["before"] > LEFT_FLOORS * FLOOR_FFR:
        room = f" These samples leave room for {_listed(a['possibly_also'], ' or ')}." if a["possibly_also"] else ""
        return f"{drops}, which recalibration takes up: it {own}. Nothing else is asked for.{room} O{error}"
    if not a["effects"]:
        return f"{artery(a['branch'])}: simulated and measured drops agree; nothing to explain."
    names = []
    for name, members in a["classes"].items():
        rivals = _listed([m for m in members if m != name], ", ")
        names.append(
            name.replace("_", " ")
            + (f", together with what these samples cannot tell from it: {rivals}" if rivals else "")
        )
    shares = ", ".join(
        f"{name.replace('_', ' ')} {s['size']:.3f} ({s['size_low']:.3f} to {s['size_high']:.3f}) of {s['of']}"
        for name, s in a["sizes"].items()
    )
    terms = ", ".join(
        f"{t['term']} {t['size']:.4g} ({t['size_low']:.4g} to {t['size_high']:.4g}) {t['unit']}".rstrip()
        for t in a["terms"]
    )
    doubt = ""
    if a["doubt"]:
        doubt = (
            " In doubt: the Gaussian process does clearly better, so what is missing has another form than this law; "
            "its sizes are of the nearest such law."
        )
    if left["after"] > AS_WELL * left["recalibration_alone"]:
        doubt += (
            " In doubt: recalibration alone, which stretches the model's own linear loss, predicts held-out samples as "
            "well."
        )
    if a["goes_together"] < TOGETHER:
        doubt += (
            f" In doubt: simulated and measured values hardly go together (rank correlation {a['goes_together']:.2f} "
            "at most); see whether a row of both tables is one sample."
        )
    if abs(a["own_loss_moved"]) > STRETCHED:
        doubt += f" With it recalibration {own} ({a['own_loss_moved']:+.1f} standard deviations of its prior)."
    if a["possibly_also"]:
        room = _listed([f"{name} ({a['inclusion'][name]:.2f})" for name in a["possibly_also"]], " or ")
        doubt += f" Beside it these samples leave room for {room}, with that probability."
    return (
        f"{drops}; missing is {' and '.join(names)} (probability {a['probability']:.2f}, chosen in "
        f"{a['share_of_folds_with_this_name']:.0%} of the folds). Sizes with 90 % intervals: {shares}; {terms}. "
        f"O{error}{doubt}"
    )


def _together(branch: Branch) -> float:
    """The largest rank correlation, over the samples, of what both tables have: pressures, flow and drop."""
    both = [
        (branch.root0, branch.root3),
        (branch.distal0, branch.distal3),
        (branch.outlet0, branch.outlet3),
        (branch.flow0, branch.flow3),
        (branch.drop0, branch.drop3),
    ]
    return max(float(spearmanr(a, b).statistic) if np.ptp(a) > 0.0 < np.ptp(b) else -1.0 for a, b in both)


def _short(left: dict) -> str:
    """In what the nearest law fails."""
    if left["after"] > left["recalibration_alone"]:
        return "predicts held-out samples worse than recalibration alone"
    return "leaves too much"


def _listed(names: list[str], word: str) -> str:
    return word.join(names).replace("_", " ")
