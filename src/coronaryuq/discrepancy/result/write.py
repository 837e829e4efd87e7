"""Files of a search: one JSON with the answer, tables for the figures, the repaired model."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core import units
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.discrepancy.data.conditions import drive_paths, held_out_names
from coronaryuq.discrepancy.data.measurements import measured_conditions
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import without_noise
from coronaryuq.discrepancy.inference.cross_validation import Gap
from coronaryuq.discrepancy.inference.noise import with_correlated
from coronaryuq.discrepancy.result.facts import by_condition, facts, prior_conflicts
from coronaryuq.discrepancy.result.pullback_table import pullback_table
from coronaryuq.discrepancy.result.repair import REPAIRED, REWIRED, repaired, rewired, wiring_statement
from coronaryuq.discrepancy.result.source_table import source_entry, source_table
from coronaryuq.discrepancy.selection.answer import MISWIRED, NOTHING, OTHER
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.next_measurement import next_measurements
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.vessels_of import vessels_shown


def summary(found: Discovery) -> dict:
    """Return the content of `discrepancy.json`, from which the summary in words is made."""
    forward, settings = found.problem.forward, found.problem.settings
    held_out, measured = held_out_names(forward.conditions), measured_conditions(found.measured)
    scheme = "held out" if held_out else "each in turn" if len(measured) > 1 else "each series in turn"
    located = [group for group in found.located.groups if group.q < settings.false_discovery_rate]
    return {
        "alarm": found.alarm,
        "consistent": found.consistent,
        "probability": {**found.answer.probabilities, "forms of something else": found.answer.forms},
        "outliers": [vars(one) for one in found.outliers],
        "uneven_noise": found.uneven,
        "noise": {quantity: vars(one) for quantity, one in found.noise.items()},
        "global_test": {"p": found.located.p, **found.located.tests},
        "prior_conflicts": prior_conflicts(found.located, forward.nuisances, settings.alarm_level),
        "prior_conflicts_remaining": prior_conflicts(found.remaining, forward.nuisances, settings.alarm_level),
        "located": [vars(group) | {"unit": "CGS"} for group in located[:40]],
        "named": named(found),
        "scales": _scales(forward.anatomy),
        "rounds": [
            [{"effect": c.effect.name, "place": c.place, "share": c.share, "score": c.z_score} for c in shortlist]
            for shortlist in (entry.shortlist[:10] for entry in found.rounds)
        ],
        "outside_library": found.outside_library,
        "not_confirmed": [
            {"effect": entry.refuted.effect.name, "place": entry.refuted.place, "log_evidence": _adds(found, entry)}
            for entry in found.rounds
            if entry.refuted is not None
        ],
        "wiring_errors": [_wiring_error(found, placed) for placed in found.answer.wiring_errors],
        "gap_before": found.gaps.before.misfit,
        "gap_after": found.gaps.before.misfit if found.outside_library else found.gaps.after.misfit,
        "gap_flexible": found.gaps.flexible.misfit,
        "expected_misfit": 1.0,
        "held_out": {
            "scheme": scheme,
            "conditions": held_out or measured,
            **{model: gap.summary() for model, gap in vars(found.gaps).items()},
            "p_held_out": found.held_out_p,
        },
        "remaining": {"p": found.remaining.p, **found.remaining.tests},
        "candidates_tested": found.candidates_tested,
        "detectable": _shown_effects(found.candidates),
        "decision_rule": asdict(RULE),
        "unknown_source": source_entry(found.nodes, found.source),
        "facts": facts(found),
    }


def _shown_effects(candidates: list[Candidate]) -> dict:
    """Count the effects that have a place in the network; list those that the fitted data would show, and others."""
    able, least = {c.effect.name for c in candidates if c.effect.nameable}, RULE.detectable_signal
    shown = able & {c.effect.name for c in candidates if c.signal >= least}
    return {"signal": least, "effects": sorted(shown), "missed": sorted(able - shown), "of": len(able)}


def _wiring_error(found: Discovery, placed: PlacedEffect) -> dict:
    """Describe a wiring error, with those that the data do not distinguish from it."""
    classes = [[c.placed for c in entry.members] for entry in found.rounds if entry.accepted is not None]
    rivals = [other for members in classes if placed in members for other in members if other != placed]
    alternatives = [text for text in map(wiring_statement, rivals) if text]
    error, place = placed
    return {"error": error.name, "place": place, "statement": wiring_statement(placed), "alternatives": alternatives}


def named(found: Discovery) -> list[dict]:
    """List the named effects: probability, class, sizes and, for a class, the measurements that best distinguish it."""
    rounds = {entry.named.placed: entry for entry in found.named}
    # In the order of the hypothesis: in a closed loop, runs start from the states of those before them.
    each = {placed: _named(found, placed, rounds[placed]) for placed in found.hypothesis if placed in rounds}
    return [each[placed] for placed in rounds]


def _named(found: Discovery, placed: PlacedEffect, entry: Round) -> dict:
    (effect, place), sizes, values = placed, {}, {}
    for parameter, z, sd in found.sizes(placed):
        values[parameter.name], *ends = parameter.with_interval(z, sd)
        sizes[parameter.name] = {"value": values[parameter.name], "interval_90": ends, "unit": parameter.unit}
    return {
        "effect": effect.name,
        "place": place,
        "probability": found.probability(entry, entry.named),
        "class": [_member(found, entry, c) for c in entry.effects],
        "wiring_errors": [
            {"statement": wiring_statement(c.placed), "probability": found.probability(entry, c)}
            for c in entry.members
            if not c.effect.nameable
        ],
        "class_probability": found.class_probability(entry),
        "log_evidence": _adds(found, entry),
        "sizes": sizes,
        "by_condition": _by_condition(found, placed),
        "beyond_prior": [parameter.name for parameter in found.beyond_prior(placed)],
        "physical": effect.physical(place, values, found.problem.forward.anatomy),
        "formula": effect.formula,
        "signature": effect.signature,
        "source": effect.source,
        "encoding": effect.native,
        "next_measurements": next_measurements(found, entry),
    }


def _adds(found: Discovery, entry: Round) -> dict | None:
    """Return the nats that an effect adds to the others, for fitted and for held-out data; None if it is alone.

    Null if the model does not run without it, and for held-out data if there are none.
    """
    if entry.held_out_gain is None:
        return None
    nats = {"fitted": entry.evidence_gain, "held_out": np.inf if found.problem.train.all() else entry.held_out_gain}
    return {name: value if np.isfinite(value) else None for name, value in nats.items()}


def _by_condition(found: Discovery, placed: PlacedEffect) -> dict:
    """Return the log odds that the first size differs between conditions, and its 90 % interval under each."""
    one = next(c for c in found.answer.constancies if c.placed == placed)
    odds = one.log_odds if np.isfinite(one.log_odds) else None
    return {"log_odds_that_it_differs": odds, **by_condition(one, found.problem.forward)}


def _member(found: Discovery, entry: Round, candidate: Candidate) -> dict:
    return {
        "effect": candidate.effect.name,
        "place": candidate.place,
        "probability": found.probability(entry, candidate),
        "side": candidate.effect.side,
        "standard_sizes": _standard_sizes(found, candidate),
    }


def _standard_sizes(found: Discovery, candidate: Candidate) -> dict:
    """Return mean and covariance of the sizes of a member in standard deviations of their priors."""
    fit, columns = candidate.fitted, slice(-len(candidate.effect.parameters), None)
    if candidate.placed in found.hypothesis.effects:
        fit, columns = found.fit, found.hypothesis.columns(found.fit.z, candidate.placed)
    mean, covariance = fit.posterior.moments()
    return {"mean": mean[columns].tolist(), "covariance": covariance[columns, columns].tolist()}


def _scales(anatomy: Anatomy) -> dict:
    """Return the run of the unmodified model that the sizes refer to, in the network's units."""
    flow = {name: anatomy.flow_scale(name) for name in anatomy.vessels}
    return {"pressure": float(anatomy.pressure), "period": float(anatomy.period), "flow": flow}


FIGURES = (
    *("tree", "residuals", "ranking", "sizes", "pullback", "source", "gap", "pairs", "pairs_gap", "pairs_effects"),
)
"""Figures on the page of an answer."""
WRITTEN = (
    *("discrepancy.json", "paragraph.txt", "located.csv", "residuals.csv", "ranking.csv", "sizes.csv", "tree.csv"),
    *("gap.csv", "pullback.csv", "source.csv", "detectable.csv", REPAIRED, REWIRED, "measurements.csv"),
    *("conditions.yaml", "difference.txt", "pairs.csv", "laws.csv", "effects.csv", "predicted.csv"),
)
"""All files that a search may write, apart from the folder `drives` and its page."""
OF_PAGE = ("report.html", *(f"figures/{name}.png" for name in FIGURES))
"""Files of the page of an answer."""
DETECTABLE = ["effect", "place", "parameter", "size", "unit", "signal"]
A_CASE = ("measurements.csv", "conditions.yaml")
"""Files that a case also has: they belong to an earlier search only if a model that it wrote is next to them."""


def clear(folder: Path) -> None:
    """Remove the files of an earlier search from `folder`: the new answer may write no model."""
    drives, model = [], any((folder / name).exists() for name in (REPAIRED, REWIRED))
    if model and (folder / "conditions.yaml").exists():
        drives = [path for path in drive_paths(folder / "conditions.yaml") if path.parent == folder / "drives"]
    ours = [folder / name for name in (*WRITTEN, *OF_PAGE) if model or name not in A_CASE]
    for path in (*ours, *drives):
        path.unlink(missing_ok=True)


def write(found: Discovery, folder: Path) -> dict:
    """Write all files into `folder` and return the summary.

    discrepancy.json; located.csv; residuals.csv; ranking.csv; sizes.csv; tree.csv; gap.csv; pullback.csv; source.csv;
    detectable.csv; and, unless something else is missing, repaired.json, measurements.csv, conditions.yaml,
    difference.txt; of a wiring error the same with rewired.json.
    """
    answer = summary(found)
    as_stated = replace(found.problem.forward, measured=found.measured)
    model = None if found.outside_library else repaired(as_stated, found.hypothesis, found.fit)
    if found.outside_library and found.answer.leading_form == MISWIRED:
        model = rewired(as_stated, found.answer.wiring_errors)
    residuals = _residuals(found)
    tables = {
        "located.csv": pd.DataFrame([vars(group) | {"unit": "CGS"} for group in found.located.groups]),
        "residuals.csv": residuals,
        "ranking.csv": _ranking(found),
        "sizes.csv": _sizes(found),
        "tree.csv": _tree(found),
        "gap.csv": _gaps(found),
        "pullback.csv": pullback_table(found, residuals),
        "source.csv": source_table(found.source),
        "detectable.csv": _detectable(found.candidates),
    }
    clear(folder)
    for name, table in tables.items():
        write_csv(folder / name, table)
    if model is not None:
        model.write(folder)
    # Last: if it exists, all other files exist.
    write_json(folder / "discrepancy.json", answer)
    return answer


def _residuals(found: Discovery) -> pd.DataFrame:
    problem = found.problem
    measured, parameters = problem.forward.measured, problem.forward.nuisances
    series = [measured[i] for i in problem.owner]
    (plain,) = found.base_problem.whitened([(without_noise(parameters, found.base.z), PLAIN)])
    (repaired,) = problem.whitened([(without_noise(parameters, found.fit.z), found.hypothesis)])
    unknown = [np.full(s.value.size, np.nan) for s in measured]
    times = np.concatenate([own if s.time is None else s.time for s, own in zip(measured, unknown, strict=True)])
    distances = np.concatenate(
        [s.pullback.distance / units.MM if s.pullback else own for s, own in zip(measured, unknown, strict=True)]
    )
    return pd.DataFrame(
        {name: [getattr(s, name) for s in series] for name in ("condition", "quantity", "location", "statistic")}
        | {
            "time": times,
            "phase": times / np.array([s.period for s in series]),
            "distance_mm": distances,
            "measured": problem.y,
            "sd": with_correlated(problem),
            "recalibrated": problem.y - plain * found.base_problem.sd,
            "repaired": problem.y - repaired * problem.sd,
            "fitted": problem.train,
            "named": bool(found.named),
        }
    )


def _ranking(found: Discovery) -> pd.DataFrame:
    """Posterior of the answers, those with names or wiring errors divided by the candidates of each round."""
    rows: list[tuple] = []
    given = found.answer.probabilities
    for number, entry in enumerate(found.rounds, start=1):
        miswired = sum(found.probability(entry, c) for c in entry.shortlist if not c.effect.nameable)
        others = {NOTHING: given[NOTHING], OTHER: max(given[OTHER] - miswired, 0.0)}
        rows += [(number, answer, "", p, np.nan, np.nan, False) for answer, p in others.items()]
        for c in entry.shortlist:
            accepted = entry.accepted is not None and entry.accepted.placed == c.placed
            rows.append((number, c.effect.name, c.place, found.probability(entry, c), c.share, c.z_score, accepted))
    return pd.DataFrame(rows, columns=["round", "effect", "place", "probability", "share", "score", "accepted"])


def _detectable(candidates: list[Candidate]) -> pd.DataFrame:
    """Signal that every candidate would leave in the fitted data at its typical size, clearest first."""
    rows = [
        (c.effect.name, c.place, parameter.name, float(parameter.from_standard(c.typical)), parameter.unit, c.signal)
        for c in sorted(candidates, key=lambda c: -c.signal)
        for parameter in c.effect.parameters[:1]
    ]
    return pd.DataFrame(rows, columns=DETECTABLE)


def _sizes(found: Discovery) -> pd.DataFrame:
    """Posterior density of every size of the named effects, on a grid."""
    rows = []
    for placed in found.hypothesis:
        effect, place = placed
        for parameter, mode, sd in found.sizes(placed):
            z = mode + sd * np.linspace(-4, 4, 161)
            size = parameter.from_standard(z)
            per_size = 1.0 / np.abs(np.gradient(size, z))
            density = per_size * np.exp(-0.5 * ((z - mode) / sd) ** 2)
            density = density / np.trapezoid(density, size)
            prior = per_size * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
            rows += [
                (effect.name, place, parameter.name, parameter.unit, *row)
                for row in zip(size, density, prior, strict=True)
            ]
    return pd.DataFrame(rows, columns=["effect", "place", "parameter", "unit", "size", "posterior", "prior"])


def _tree(found: Discovery) -> pd.DataFrame:
    """Tabulate every vessel's parent, largest misfit and named effects.

    The misfit is the largest score (standard deviations) measured at either end; effects act at the vessel or its bed,
    or on a sensor that reads there.
    """
    anatomy = found.problem.forward.anatomy
    worst: dict[str, float] = {}
    for group in found.located.groups:
        vessel = anatomy.beds.get(group.location) or anatomy.vessel_at(group.location)
        if vessel:
            worst[vessel] = max(worst.get(vessel, 0.0), abs(group.score))
    rows = [
        (
            name,
            next(iter(anatomy.parents(name)), ""),
            anatomy.flow_scale(name),
            worst.get(name, np.nan),
            "; ".join(
                f"{effect.name} at {place}"
                for effect, place in (entry.named.placed for entry in found.named)
                if name in vessels_shown(place, anatomy)
            ),
        )
        for name in anatomy.vessels
    ]
    return pd.DataFrame(rows, columns=["vessel", "parent", "mean_flow", "disagreement", "named"])


def _gaps(found: Discovery) -> pd.DataFrame:
    models = (
        ("recalibration alone", found.gaps.before),
        ("with the named effects" if found.named else "with the most probable effect", found.gaps.after),
        ("flexible discrepancy", found.gaps.flexible),
        ("effects and flexible discrepancy", found.gaps.both),
    )
    return pd.DataFrame(
        [gap_row(*one) for one in models],
        columns=["model", "misfit", "low", "high", "log_predictive_density", "expected_misfit"],
    )


def gap_row(name: str, gap: Gap) -> tuple:
    """Return a row of `gap.csv`."""
    return name, gap.misfit, *gap.interval, gap.lpd, 1.0
