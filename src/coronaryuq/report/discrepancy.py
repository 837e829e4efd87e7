"""What a search for a missing effect found, as a section of the report and as a page of its own."""

import base64
from collections.abc import Sequence
from pathlib import Path

import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from coronaryuq.core import provenance, units
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.discrepancy.table_model.tables import artery

CAPTIONS = {
    "tree": "Vessels from left to right as they divide, coloured by their largest disagreement after recalibration. "
    "Diamonds: the named effects, on the vessel or at the bed where they act.",
    "residuals": "Measured with its noise, recalibrated, and with the effects that are named or come nearest: the "
    "series with the largest misfit over the cycle or, where no waveform was measured, predicted against measured.",
    "ranking": "Candidates of every round of the search and their probabilities, given the library.",
    "sizes": "Posterior and prior of the sizes of the effects that are named or come nearest.",
    "gap": "Misfit on measurements kept out of every fit, with 90 % intervals: residuals over what noise and the fit's "
    "own spread let expect.",
    "pairs": "Pressure drop against flow, and FFR on held-out samples, branch by branch.",
    "pairs_gap": "Error of FFR on held-out samples, with 90 % intervals over samples.",
    "pairs_effects": "Probability that each effect is part of a branch's law of pressure loss.",
}
TITLES = {
    "pairs": "Pairs of simulated and measured outputs",
    "hidden": "An effect hidden in the tuned loop",
}
SHOWN = 6
"""Disagreements listed at most."""


def environment() -> Environment:
    """Templates beside this file."""
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_page(
    answers: Sequence[str],
    figures: Sequence[str],
    campaign: str,
    settings: dict,
    out: str | Path,
    truths: Sequence[str] = (),
) -> None:
    """Write the page of a discrepancy campaign. answers: `discrepancy.json` of every case; figures: PNG files; truths:
    `truth.json` of cases made here, and `gap.json`, the gap with the true effect.
    """
    context = {
        "campaign": campaign,
        "searches": searches(answers, figures, truths),
        "settings": yaml.safe_dump(settings, sort_keys=False),
        "provenance": [(f"SHA-256 of {case_of(path)}", provenance.checksum(path)) for path in answers],
    }
    write_text(out, environment().get_template("discrepancy_page.html").render(context))


def case_of(path: str | Path) -> str:
    """Name of the case that a file under `discrepancy/CASE/found/` or `discrepancy/CASE/figures/` belongs to."""
    return Path(path).parts[-3]


def searches(answers: Sequence[str], figures: Sequence[str], truths: Sequence[str] = ()) -> list[dict]:
    """Every case as the templates want it."""

    def of_case(files, path):
        return [file for file in files if case_of(file) == case_of(path)]

    return [_search(path, of_case(figures, path), of_case(truths, path)) for path in answers]


def _search(path: str, figures: list[str], truths: list[str]) -> dict:
    answer = read_json(path)
    pairs, known = "gap_unit" in answer, {Path(file).stem: file for file in truths}
    order = {name: number for number, name in enumerate(CAPTIONS)}
    return {
        "title": TITLES.get("pairs" if pairs else case_of(path), case_of(path)),
        "paragraph": answer["paragraph"],
        "truth": _against(read_json(known["truth"]), answer["named"]) if "truth" in known else "",
        "named": [_named(one) for one in answer["named"]],
        "located": [] if pairs else [_located(row) for row in answer["located"][:SHOWN]],
        **(_pair_gaps(answer) if pairs else _gaps(answer, read_json(known["gap"]) if "gap" in known else None)),
        "figures": [
            {"caption": CAPTIONS[Path(f).stem], "data": embedded(f)}
            for f in sorted(figures, key=lambda f: order[Path(f).stem])
        ],
    }


def _against(truth: dict, named: list[dict]) -> str:
    """What was hidden, and how well the answer does beside it."""
    effect, place = truth["effect"], truth["place"]
    sizes = ", ".join(f"{name} {value:.3g}" for name, value in truth["sizes"].items())
    hidden = (
        f"This case was made here: {effect.replace('_', ' ')} at {place} ({sizes}) was hidden in the data, a trace of "
        f"{truth['visible_sd']:.0f} standard deviations of the noise that recalibration cannot absorb. The search saw "
        "the model without it, the measurements and their conditions."
    )
    classes = [[(m["effect"], m["place"]) for m in one["class"]] for one in named]
    if named and (named[0]["effect"], named[0]["place"]) == (effect, place):
        verdict = "Its first answer is right in name and place"
    elif any((effect, place) in members for members in classes):
        verdict = "The right name and place are in a class of answers that these data cannot tell apart"
    elif any(effect == name for members in classes for name, _ in members):
        verdict = "The effect is named, at another place"
    else:
        verdict = "It was not found"
    beside = len(named) - 1 if "It was" not in verdict else len(named)
    more = f"; it also names {beside} that {'is' if beside == 1 else 'are'} not there" if beside > 0 else ""
    return f"{hidden} {verdict}{more}."


def _named(one: dict) -> dict:
    sizes = [
        f"{name} {size['value']:.3g} ({size['interval_90'][0]:.3g} to {size['interval_90'][1]:.3g})"
        for name, size in one.get("sizes", {}).items()
    ] or [
        _interval(f"of {one['size']['of']}", one["size"]),
        *(_interval(t["unit"], t, t["term"]) for t in one["terms"]),
    ]
    others = [f"{m['effect']} at {m['place']}" for m in one["class"][1:]]
    wanted = [f"mean {m['quantity']} at {m['location']} under {m['condition']}" for m in one.get("separate_by", [])[:1]]
    return {
        "effect": one["effect"].replace("_", " "),
        "place": one["place"],
        "probability": _probability(one),
        "sizes": ", ".join(sizes),
        "others": ", ".join(others).replace("_", " ") or "–",
        "separate_by": "".join(wanted),
        "formula": one["formula"],
        "looks_like": one.get("looks_like", ""),
        "source": one["source"],
        "written_as": one.get("written_as", ""),
    }


def _interval(unit: str, size: dict, name: str = "") -> str:
    """A size of a pairs answer with its 90 % interval."""
    return f"{name} {size['size']:.3g} ({size['size_low']:.3g} to {size['size_high']:.3g}) {unit}".strip()


def _probability(one: dict) -> str:
    """That of a class of answers, and of its member that is named where it has others."""
    whole, members = one.get("class_probability", one["probability"]), one["class"]
    return f"{whole:.2f}" + (f", of this member {members[0]['probability']:.2f}" if len(members) > 1 else "")


def _located(row: dict) -> dict:
    phase = row["phase"]
    return {
        "what": f"{row['quantity']} at {row['location']}, {row['statistic']}",
        "condition": row["condition"],
        "phase": "–" if phase is None else f"{phase[0]:.2f} to {phase[1]:.2f}",
        "score": f"{row['score']:+.1f}",
        "q": f"{row['q']:.2g}" if row["q"] > 0 else "below 1e-300",
    }


def _gaps(answer: dict, known: dict | None) -> dict:
    """known: the gap with the true effect, of a case made here."""
    held = answer["held_out"]
    told = [
        ("recalibration alone", held["before"]),
        ("with the named effects" if answer["named"] else "with what comes nearest", held["after"]),
        ("flexible discrepancy (Gaussian process)", held["flexible"]),
        ("both together", held["both"]),
        *([("with the true effect", known)] if known else []),
    ]
    rows = []
    for name, gap in told:
        low, high = gap["interval_90"]
        errors = [_rmse(quantity, value) for quantity, value in gap["rmse"].items()]
        values = [f"{gap['misfit']:.2f} ({low:.2f} to {high:.2f})", ", ".join(errors)]
        rows.append({"name": name, "values": [*values, f"{gap['log_predictive_density_per_row']:.2f}"]})
    conditions = held["conditions"]
    kept = conditions if isinstance(conditions, str) else ", ".join(conditions)
    return {
        "gap_heading": f"Kept out of every fit: {kept}",
        "gap_columns": ["Misfit (floor 1)", "RMSE", "Log predictive density per row"],
        "gaps": rows,
    }


def _rmse(quantity: str, value: float) -> str:
    scale, unit = {
        "pressure": (1 / units.MMHG, "mmHg"),
        "flow": (1 / units.ML_PER_MIN, "mL/min"),
        "perfusion": (1 / units.MBF_PER_MIN_PER_G, "mL/min/g"),
        "volume": (1.0, "mL"),
    }.get(quantity, (1.0, ""))
    return f"{quantity} {value * scale:.3g} {unit}".strip()


def _pair_gaps(answer: dict) -> dict:
    columns = {
        "before": "As it is",
        "recalibration_alone": "Recalibrated",
        "after": "With the named effects",
        "flexible": "Gaussian process",
    }
    rows = [
        {
            "name": f"{artery(branch['branch'])}, {branch['place']}",
            "values": [f"{branch['ffr_rmse'][k]:.4f}" for k in columns],
        }
        for branch in answer["held_out"]["branches"]
    ]
    return {
        "gap_heading": "Error of FFR, root mean square, held-out samples",
        "gap_columns": list(columns.values()),
        "gaps": rows,
    }


def embedded(path: str) -> str:
    """A PNG file as the address of an image inside a page."""
    return "data:image/png;base64," + base64.b64encode(Path(path).read_bytes()).decode()
