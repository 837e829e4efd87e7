"""Summary of a search as one paragraph of plain English, from the JSON of its answer alone.

The search does not import this module: an edit of the text makes no search stale.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.core.wording import capitalised, interval_text, listed, p_text
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.result import phrases
from coronaryuq.discrepancy.selection.answer import MISWIRED, NAMES, NOTHING, OTHER, SOURCE, UNLISTED, VARYING

STAND_IN = "it may be a surrogate for a mechanism outside the library. "
RESIDUALS = "The residual waveforms show where it acts and its shape."
EACH = "each condition, held out in turn,"
NEAREST, LEAST_SHARE = 3, 0.1
"""Number of effects that are listed where none is named, and the least share of each."""
SURE = 0.9
"""Probability from which a statement has no "probably"."""
DENSITY, WORSE = "log_predictive_density_per_row", 0.01
"""Nats per row by which it is worse from where that is worth a sentence: a factor of twenty over 300 rows."""


def write_paragraph(answer_json: str | Path, paragraph_txt: str | Path) -> str:
    """Write the summary of an answer (`discrepancy.json`) to a text file and return it."""
    text = paragraph(read_json(answer_json, ("facts",)))
    write_text(paragraph_txt, text + "\n")
    return text


def paragraph(answer: Mapping) -> str:
    """Summarise the misfit, the missing effects, their probability and the decrease of the held-out misfit.

    Parameters
    ----------
    answer
        Content of `discrepancy.json`, as `result.write.summary` returns it.
    """
    facts, gaps, held_out = answer["facts"], answer["held_out"], _held_out(answer)
    count, p = facts["measurements"], answer["global_test"]["p"]
    notes = phrases.uneven_notes(answer["uneven_noise"]) + phrases.noise_notes(answer["noise"])
    notes += phrases.outlier_notes(answer["outliers"])
    if answer["consistent"]:
        nothing = facts["answer"]["probabilities"][NOTHING]
        other = f"; that something is missing, {1.0 - nothing:.2f}" if nothing < SURE else ""
        agreement = (
            f"leaves a misfit to the {count} fitted measurements (global test {p_text(p)}), {_where(facts['worst'])}, "
            "but one that errors of the model, its parameters and the measurements explain: nothing is missing"
            if answer["alarm"]
            else f"agrees with the {count} fitted measurements (global test {p_text(p)}): there is nothing to explain"
        )
        said = [
            f"After recalibration, the model {agreement} (probability {nothing:.2f}{other}).",
            f"On {_held_out_text(answer)} its misfit is {gaps['before']['misfit']:.2f} ({phrases.EXPECTED_MISFIT}).",
            phrases.detectable_text(answer["detectable"]),
            phrases.overstated_sd_warning(facts["scatter"]),
            phrases.prediction_warning(gaps["p_held_out"], held_out),
            phrases.conflict_text("Recalibration moves", answer["prior_conflicts"]),
        ]
        return _joined(*said, notes)
    text = (
        f"The model disagrees with the {count} fitted measurements beyond what recalibration can explain "
        f"(global test {p_text(p)}), {_where(facts['worst'])}. "
        if answer["alarm"]
        else f"The global test of the {count} fitted measurements finds no misfit ({p_text(p)}), but all data together "
        "are more probable if something is missing. "
    )
    moved = phrases.conflict_text("Without an effect, recalibration has to move", answer["prior_conflicts"])
    if answer["outside_library"]:
        text += _outside_library(answer, held_out)
        text += "" if _unseen(answer, held_out) else _shown(facts, answer["unknown_source"])
        return _joined(text, moved, notes)
    for number, effect in enumerate(answer["named"]):
        best = "The best" if facts["answer"]["probabilities"][NAMES] >= SURE else "The likeliest"
        text += f"{best} explanation is " if number == 0 else "A further effect is "
        text += _named_effect(effect, facts["best"])
    text += _not_confirmed(answer) + _remaining(answer, held_out)
    return _joined(text, moved, notes)


def _joined(*sentences: str) -> str:
    return " ".join(" ".join(sentences).split())


def _where(worst: Mapping) -> str:
    """State where the misfit is largest."""
    return f"most strongly in the {worst['quantity']} at {worst['location']} under {worst['condition']}"


def _outside_library(answer: Mapping, held_out: list[str]) -> str:
    """State what speaks against the best candidates."""
    gaps, best, forms = answer["held_out"], answer["facts"]["best"], answer["facts"]["answer"]
    one, certainty = len(best) == 1, forms["probabilities"][OTHER]
    start = f"Something other than an effect of the library is missing (probability {certainty:.2f})"
    if _unseen(answer, held_out):
        return (
            f"Something is missing (probability {certainty:.2f}) that only the held-out conditions "
            f"({', '.join(held_out)}) show. No effect is named, because none is fitted to these: hold out another one."
        )
    residuals = RESIDUALS if answer["facts"]["waveforms"] else ""
    if not best:
        return f"{start}{', probably ' * bool(_kind(forms))}{_kind(forms)}. {_nearest(answer)}{residuals}".rstrip()
    labels = listed([phrases.label_text(effect) for effect in best])
    candidate = "the best candidate" if one else "the best candidates"
    change = (
        f"With {labels}, the misfit on {_held_out_text(answer)} "
        f"{phrases.misfit_change(gaps['before']['misfit'], gaps['after']['misfit'])}."
    )
    if forms["leading_form"] == MISWIRED:
        return _miswired(answer)
    implausible = [effect for effect in best if effect["implausible"]]
    if implausible:
        sizes = listed(
            [f"{phrases.label_text(effect)} ({phrases.size_text(effect['sizes'])})" for effect in implausible]
        )
        reason = (
            f"{candidate} would be {labels}, but {sizes} would be more than {RULE.implausible:.0f} standard deviations "
            f"from the prior's mean. No effect is named. {change}"
        )
    elif forms["leading_form"] == VARYING and any(effect["varying"] for effect in best):
        reason = f"{phrases.varying_text(best)}. No effect is named. {change}"
    elif likely := _kind(forms):
        reason = (
            f"{candidate} {'is' if one else 'are'} {labels}, but {likely} is likelier. No effect is named. {change}"
        )
    elif forms["support_nats"] < 1.0:
        reason = f"no effect of the library explains any of the misfit. {residuals} No effect is named."
    else:
        reason = (
            f"{candidate}, {labels}, {'explains' if one else 'explain'} only a part of it (probability of the "
            f"name{'' if one else 's'} {forms['probabilities'][NAMES]:.2f}; evidence beside an unknown error "
            f"{max(forms['support_nats'], 0.0):.0f} nats). {residuals} No effect is named. {change}"
        )
    return f"{start}: {reason}"


def _kind(forms: Mapping) -> str:
    """Name what something else is, if its likeliest form says that."""
    if forms["leading_form"] == SOURCE:
        return "a flow into or out of the vessels at one node"
    if forms["leading_form"] != UNLISTED:
        return ""
    signals = listed([f"the {signal}" for signal in forms["picked_up"]], "or")
    response = f"a linear response, not listed in the library, of the device that reads {forms['device']}"
    return f"{response} to {signals}" if signals else response


def _nearest(answer: Mapping) -> str:
    """List the effects that come nearest where none is worth naming."""
    first = (answer["rounds"] or [[]])[0]
    near = [f"{phrases.label_text(one)} ({one['share']:.2f})" for one in first[:NEAREST] if one["share"] >= LEAST_SHARE]
    are = "the likeliest, with its share, is" if len(near) == 1 else "the likeliest, with their shares, are"
    return f"No effect of the library is worth naming; {are} {listed(near)}. " * bool(near)


def _unseen(answer: Mapping, held_out: list[str]) -> bool:
    """Whether something is missing that probably shows under a held-out condition alone."""
    return not (answer["facts"]["best"] or answer["alarm"]) and _likeliest(answer["facts"])["condition"] in held_out


def _likeliest(facts: Mapping) -> Mapping:
    """Return in which data something else most probably shows."""
    return max(facts["answer"]["shows_in"], key=lambda one: one["probability"])


def _miswired(answer: Mapping) -> str:
    """State the wiring errors that were found, or that are likelier than the effects found."""
    best, forms = answer["facts"]["best"], answer["facts"]["answer"]["forms_of_something_else"]
    errors = [(error["error"], error["place"]) for error in answer["wiring_errors"]]
    others = [phrases.label_text(effect) for effect in best if (effect["effect"], effect["place"]) not in errors]
    text = (
        f"The measurements indicate a wiring error of the model (probability {forms[MISWIRED]:.2f}): "
        f"{listed([_wiring(error) for error in answer['wiring_errors']])}. No effect is named; rewired.json is the "
        "model with this corrected: check it, and search again."
    )
    besides = "also" if len(others) < len(best) else "instead"
    text += f" {capitalised(listed(others))} may {besides} be present." if others else ""
    left = f" Something remains unexplained ({p_text(answer['remaining']['p'])})."
    return text + left * answer["facts"]["unexplained"]


def _wiring(error: Mapping) -> str:
    """State a wiring error, with those that the data do not distinguish from it."""
    others = "; or ".join(error["alternatives"])
    return error["statement"] + (f" (or, not distinguished by these data: {others})" if others else "")


def _shown(facts: Mapping, source: Mapping | None) -> str:
    """State in which data alone something else shows, if that is probable, and where an unknown flow may be."""
    forms, likeliest = facts["answer"], _likeliest(facts)
    quantity, place, condition = likeliest["quantity"], likeliest["location"], likeliest["condition"]
    if forms["leading_form"] in (MISWIRED, SOURCE) or not (quantity or condition) or likeliest["probability"] < 0.5:
        return _source(source)
    if not quantity:
        data = f"the data under {condition}"
        cause = "check how they were recorded, and what else differs under this condition."
    elif place:
        data = f"the {quantity} at {place}{f' under {condition}' if condition else ''}"
        unseen = {"flow": "flow or bed", "pressure": "loss of pressure"}.get(quantity)
        cause = f"an error of that measurement{f', or a {unseen} that it alone shows' if unseen else ''}."
    elif condition:
        data = f"the {quantity} data under {condition}"
        cause = f"check how they {'and the drive ' if facts['driven'] else ''}were recorded, and what differs then."
    else:
        data, drive = f"the {quantity} data", " or of the drive" if facts["driven"] else ""
        cause = f"an error that they share{drive}, or a cause that hardly changes other quantities."
    probability, likely = likeliest["probability"], " probably" * (likeliest["probability"] < SURE)
    said = f" It{likely} shows in {data} alone (probability {probability:.2f}): {cause}"
    # A source elsewhere would show at other places, too.
    elsewhere = place and source and source.get("vessel") not in place.split(":")
    return said + (_source(source) if quantity == "flow" and not elsewhere else "")


def _source(found: Mapping | None) -> str:
    """State where an unknown source of flow would explain most, and which law its waveform follows, if it explains."""
    if not found or "vessel" not in found or found["nodes"][0]["nats"] < RULE.class_odds:
        return ""
    best = f" Of unknown sources of flow, one at the end of {found['vessel']} explains most"
    nats = found["nodes"][0]["nats"]
    rivals = [one["vessel"] for one in found["nodes"][1:] if one["nats"] > nats - RULE.class_odds]
    text = f"{best} ({nats:.0f} nats{f'; {listed(rivals)} as well' if rivals else ''})"
    probability = found["laws"][found["law"]]
    if found["law"] not in found["says"]:
        return f"{text}; its waveform follows no law of one size in all conditions (probability {probability:.2f})."
    size, low, high = found["sizes"][found["law"]]
    return (
        f"{text}; its waveform is {found['says'][found['law']]} (probability {probability:.2f}), with a mean of "
        f"{interval_text(size, low, high)} of the vessel's flow (positive if blood leaves)."
    )


def _named_effect(named: Mapping, best: Sequence[Mapping]) -> str:
    """Describe a named effect: probability, size, measurements that would distinguish its class, and doubts."""
    facts = next(e for e in best if (e["effect"], e["place"]) == (named["effect"], named["place"]))
    probability, size = phrases.class_probability_text(named["class"]), phrases.size_text(facts["sizes"])
    text = f"{phrases.label_text(named)}{phrases.within_text(named)} ({probability}; {size}). "
    text += facts["assumption"]
    if named["wiring_errors"]:
        statements = listed([f"{one['statement']} ({one['probability']:.2f})" for one in named["wiring_errors"]])
        text += f"These data do not exclude a wiring error of the model instead: {statements}. "
    text += phrases.next_measurement_text(named["next_measurements"])
    for size in facts["beyond_prior"]:
        text += (
            f"Its {size['label']} lies outside the central 99 % of its prior "
            f"({size['low']:.3g} to {size['high']:.3g}): {STAND_IN}"
        )
    if facts["varying"]:
        text += (
            "Its size differs when it is fitted to each condition separately "
            f"({phrases.sizes_by_condition(facts['varying'])}): "
            f"it may change between conditions, or {STAND_IN.removeprefix('it ')}"
        )
    nats = (named["log_evidence"] or {}).get("held_out")
    if nats is not None and nats < 0.0:
        text += f"The held-out data are predicted better without it (by {-nats:.2g} nats in total): {STAND_IN}"
    return text


def _not_confirmed(answer: Mapping) -> str:
    """List effects that the fitted measurements suggest but the held-out data do not confirm."""
    if not (answer["named"] and answer["not_confirmed"]):
        return ""
    effects = [phrases.label_text(effect) for effect in answer["not_confirmed"]]
    them = "it" if len(effects) == 1 else "them"
    return f"The fitted measurements also suggest {listed(effects)}, but the held-out data do not confirm {them}. "


def _remaining(answer: Mapping, held_out: list[str]) -> str:
    """State the change of the held-out misfit and what remains unexplained."""
    gaps, p, named = answer["held_out"], answer["remaining"]["p"], bool(answer["named"])
    before, after = gaps["before"], gaps["after"]
    text = f"On {_held_out_text(answer)} the misfit {phrases.misfit_change(before['misfit'], after['misfit'])}. "
    if named and not held_out:
        one = len(answer["held_out"]["conditions"]) == 1
        remedy = "measure another condition and hold it out" if one else "hold a condition out"
        text += f"This does not test the names, which were chosen using all conditions: {remedy} to test them. "
    if named and after[DENSITY] < before[DENSITY] - WORSE:
        text += (
            "The held-out data are predicted worse with the named effects than with recalibration alone (log "
            f"predictive density per row {after[DENSITY]:.2f}, {before[DENSITY]:.2f}). "
        )
    if named and gaps["p_held_out"] < phrases.UNPREDICTED:
        text += f"The named effects do not predict all of the held-out data ({p_text(gaps['p_held_out'])}). "
    left = answer["facts"]["unexplained"]
    text += f"{'Something remains unexplained' if left else 'The fitted data show no further misfit'} ({p_text(p)}). "
    if named:
        text += phrases.conflict_text(
            "With the named effects, recalibration still moves", answer["prior_conflicts_remaining"]
        )
    return text


def _held_out(answer: Mapping) -> list[str]:
    """Return the conditions that were held out of every fit."""
    held_out = answer["held_out"]
    return held_out["conditions"] if held_out["scheme"] == "held out" else []


def _held_out_text(answer: Mapping) -> str:
    held_out = answer["held_out"]
    if held_out["scheme"] == "held out":
        return f"the held-out conditions ({', '.join(held_out['conditions'])})"
    return "each series, held out in turn," if held_out["scheme"] == "each series in turn" else EACH
