"""Results of searches for missing effects: a section of the report, and a separate page."""

import re
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.core.units import percent
from coronaryuq.discrepancy.result.phrases import size_text, within_text, worth_measuring
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.table_model.tables import artery
from coronaryuq.figures.discrepancy import words_of
from coronaryuq.figures.units_shown import shown_in
from coronaryuq.report.captions import INVENTED, SEARCHES, category_of_search
from coronaryuq.report.embedding import data_url, in_code, in_script

TITLES = {
    "pairs": "Pairs of simulated and measured outputs",
    INVENTED: "Self-test: an invented effect, hidden in the bundled patient's loop",
}
SHOWN = 6
"""Maximum number of misfits listed."""


def environment() -> Environment:
    """Return the environment of the templates in this folder."""
    made = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"code": in_code, "in_script": in_script}
    return made


def write_page(
    answers: Sequence[str],
    figures: Sequence[str],
    campaign: str,
    settings: dict,
    out: str | Path,
    truths: Sequence[str] = (),
    case: str | Path | None = None,
    tree: str | Path | None = None,
    of_patient: Sequence[str] = (),
) -> None:
    """Write the page of a discrepancy campaign.

    Parameters
    ----------
    answers
        `discrepancy.json` of each case.
    figures
        PNG files, named as in `captions.SEARCHES`.
    campaign
        Name of the campaign.
    settings
        Its block `discrepancy`.
    out
        The page, HTML.
    truths
        Of synthetic cases: `truth.json`, and `gap.json`, the misfit with the true effect.
    case, tree
        `case.json` and `tree.vtp` of the patient, if any search is of the patient's network.
    of_patient
        These searches; their vessels, beds and places have the names of the case.
    """
    in_words, found = words_of(case, tree), searches(answers, figures, truths)
    context = {
        "campaign": campaign,
        "title": title(found),
        "note": "",
        "searches": [
            in_words(one) if case_of(path) in of_patient else one for path, one in zip(answers, found, strict=True)
        ],
        "settings": yaml.safe_dump(settings, sort_keys=False),
        "provenance": [(f"SHA-256 of {case_of(path)}", provenance.checksum(path)) for path in answers],
    }
    write_text(out, environment().get_template("discrepancy_page.html").render(context))


def case_of(path: str | Path) -> str:
    """Return the case of a file in `discrepancy/CASE/found/` or `discrepancy/CASE/figures/`."""
    return Path(path).parts[-3]


def searches(
    answers: Sequence[str], figures: Sequence[str], truths: Sequence[str] = (), *, first_figure: int = 1
) -> list[dict]:
    """Return each case in the form for the templates; figures are numbered on from the first, see `write_page`."""

    def of_case(files, path):
        return [file for file in files if case_of(file) == case_of(path)]

    numbers = count(first_figure)
    return [searched(path, case_of(path), of_case(figures, path), numbers, of_case(truths, path)) for path in answers]


def title(found: Sequence[dict]) -> str:
    """Return the heading of some searches, which must not present an invented effect as one of the patient."""
    return category_of_search(bool(found) and all(search["invented"] for search in found))


def searched(
    path: str | Path, case: str, figures: Sequence[str], numbers: Iterator[int], truths: Sequence[str] = ()
) -> dict:
    """Return one search in the form for the templates; path: of its `discrepancy.json`; the rest as of `write_page`."""
    answer = read_json(path)
    pairs, truth_files = "gap_unit" in answer, {Path(file).stem: file for file in truths}
    order = {name: number for number, name in enumerate(SEARCHES)}
    described = {} if pairs else {(one["effect"], one["place"]): one["sizes"] for one in answer["facts"]["best"]}
    return {
        "title": TITLES.get("pairs" if pairs else case, case),
        "invented": case == INVENTED,
        "paragraph": answer["paragraph"] if pairs else paragraph(answer),
        "truth": _verdict(read_json(truth_files["truth"]), answer["named"]) if "truth" in truth_files else "",
        "named": [_named(one, described.get((one["effect"], one["place"]))) for one in answer["named"]],
        "located": [] if pairs else [_located(row) for row in answer["located"][:SHOWN]],
        **(
            _pair_gaps(answer)
            if pairs
            else _gaps(answer, read_json(truth_files["gap"]) if "gap" in truth_files else None)
        ),
        "figures": [
            {
                "number": next(numbers),
                "anchor": f"fig-{re.sub(r'[^A-Za-z0-9]+', '-', case)}-{Path(f).stem}",
                "caption": SEARCHES[Path(f).stem],
                "data": data_url(f),
                "file": Path(f).name,
            }
            for f in sorted(figures, key=lambda f: order[Path(f).stem])
        ],
    }


def _verdict(truth: dict, named: list[dict]) -> str:
    """Describe the hidden effect and state whether the answer is correct."""
    effect, place = truth["effect"], truth["place"]
    sizes = ", ".join(f"{name} {value:.3g}" for name, value in truth["sizes"].items())
    hidden = (
        f"These measurements are invented: {effect.replace('_', ' ')} at {place} ({sizes}) was hidden in them. Its "
        f"signal after recalibration is {truth['visible_sd']:.0f} standard deviations of the noise. The search used "
        "only the model without the effect, the measurements and their conditions."
    )
    classes = [[(member["effect"], member["place"]) for member in answer["class"]] for answer in named]
    found = True
    if named and (named[0]["effect"], named[0]["place"]) == (effect, place):
        verdict = "The first answer is the true effect at its location"
    elif any((effect, place) in members for members in classes):
        verdict = "The true effect at its location is in a class of answers that these data cannot distinguish"
    elif any(effect == name for members in classes for name, _ in members):
        verdict = "It named the effect at another place"
    else:
        verdict, found = "It did not find the effect", False
    false = len(named) - found
    more = f"; it also named {false} {'effect that is' if false == 1 else 'effects that are'} not present"
    return f"{hidden} {verdict}{more if false > 0 else ''}."


def _named(effect: dict, described: list[dict] | None) -> dict:
    """Return a named effect for the templates; described: its sizes in words, as of `facts.described_sizes`."""
    sizes = (
        [size_text(described)]
        if described
        else [
            _interval(f"of {effect['size']['of']}", effect["size"]),
            *(_interval(term["unit"], term, term["term"]) for term in effect["terms"]),
        ]
    )
    others = [f"{member['effect']} at {member['place']}" for member in effect["class"][1:]]
    next_measurement = worth_measuring(effect.get("next_measurements", []))[:1]
    return {
        "effect": effect["effect"].replace("_", " "),
        "place": effect["place"] + within_text(effect),
        "probability": _probability(effect),
        "sizes": ", ".join(sizes),
        "others": ", ".join(others).replace("_", " ") or "–",
        "next_measurements": "".join(
            f"mean {m['quantity']} at {m['location']} under {m['condition']}" for m in next_measurement
        ),
        "formula": effect["formula"],
        "signature": effect.get("signature", ""),
        "source": effect["source"],
        "encoding": effect.get("encoding", ""),
    }


def _interval(unit: str, size: dict, name: str = "") -> str:
    """Format a size of a pairs answer with its 90 % interval."""
    return f"{name} {size['size']:.3g} ({size['size_low']:.3g} to {size['size_high']:.3g}) {unit}".strip()


def _probability(effect: dict) -> str:
    """Format the probability of a class of answers, and of its first member if it has several."""
    whole, members = effect.get("class_probability", effect["probability"]), effect["class"]
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


def _gaps(answer: dict, true_gap: dict | None) -> dict:
    held = answer["held_out"]
    models = [
        ("recalibration alone", held["before"]),
        ("with the named effects" if answer["named"] else "with the most probable effect", held["after"]),
        ("flexible discrepancy (Gaussian process)", held["flexible"]),
        ("effects and flexible discrepancy", held["both"]),
        *([("with the true effect", true_gap)] if true_gap else []),
    ]
    rows = []
    for name, gap in models:
        low, high = gap["interval_90"]
        errors = [_rmse(quantity, value) for quantity, value in gap["rmse"].items()]
        values = [f"{gap['misfit']:.2f} ({low:.2f} to {high:.2f})", ", ".join(errors)]
        rows.append({"name": name, "values": [*values, f"{gap['log_predictive_density_per_row']:.2f}"]})
    conditions = ", ".join(held["conditions"])
    return {
        "gap_heading": f"Held out: {conditions}" + (f", {held['scheme']}" if held["scheme"] != "held out" else ""),
        "gap_columns": [
            "Misfit (expected: 1)",
            "RMSE",
            "Log predictive density per row",
        ],
        "gaps": rows,
        "predictions": [],
    }


def _rmse(quantity: str, value: float) -> str:
    scale, unit = shown_in(quantity)
    return f"{quantity} {value / scale:.3g} {unit}".strip()


def _pair_gaps(answer: dict) -> dict:
    columns = {
        "before": "Unchanged",
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
        "gap_heading": "Root mean square error of FFR, held-out samples",
        "gap_columns": list(columns.values()),
        "gaps": rows,
        # Answers of version 0.2.0 have none.
        "predictions": [
            _pair_prediction(branch) for branch in answer["held_out"]["branches"] if "prediction" in branch
        ],
    }


def _pair_prediction(branch: dict) -> dict:
    """Return the repaired model of a branch in words, and FFR over the samples by each model."""
    own, added = branch["recalibration"]["own"], branch["coefficients"] if branch["effects"] else {}
    law = "".join(
        f" + {added[term]:.3g} {unit}" for term, unit in {"linear": "Q", "quadratic": "Q²"}.items() if term in added
    )
    models = {"simulated": "Unchanged", "recalibrated": "Recalibrated", "repaired": "With the named effects"}
    rows = []
    for name, words in (models | {"measured": "Measured"}).items():
        said = branch["prediction"][name]
        shares = [f"{percent(share)}" for share in said["at_most"].values()]
        rows.append(
            {"name": words, "values": [f"{said['median']:.3f} ({said['low']:.3f} to {said['high']:.3f})", *shares]}
        )
    return {
        "artery": artery(branch["branch"]),
        "law": f"{own:.2g} × the model's own loss{law}",
        "columns": ["FFR, median (90 % of the samples)", *(f"FFR at most {one}" for one in said["at_most"])],
        "rows": rows,
    }
