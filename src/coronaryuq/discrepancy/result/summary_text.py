"""Summary of a search as one paragraph of plain English, from the JSON of its answer alone.

The search does not import this module: an edit of the text makes no search stale.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.selection.answer import NAMES, NOTHING, OTHER, REROUTED, UNLISTED, VARYING
from coronaryuq.discrepancy.selection.flow_conservation import PROBE

LEAST_INFORMATION = 0.1
"""Expected information (nats) below which a measurement does not distinguish a class; of two members at most 0.69."""
EXPECTED_MISFIT = "1 is expected from noise and fit uncertainty"
QUIET, UNLIKELY = 0.5, 1e-4
"""Scatter over the stated standard deviation, and its probability, below which the latter is reported as too large."""
UNPREDICTED = 0.001
"""p-value of the held-out data below which the text says that they are not predicted."""
MOST_LISTED = 4
"""Maximum number of nuisance parameters or samples listed in one sentence."""
STAND_IN = "it may be a surrogate for a mechanism outside the library. "
EACH = "each condition, held out in turn,"
DENSITY = "log_predictive_density_per_row"


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
    data_notes = noise_notes(answer["noise"]) + outlier_notes(answer["outliers"])
    if answer["consistent"]:
        text = data_notes + (
            f"After recalibration within its priors, the model agrees with the {count} fitted measurements "
            f"(global test {p_text(p)}): there is nothing to explain. "
            + (f"{_own_error(facts)} " if answer["alarm"] else "")
            + f"On {_held_out_text(answer)} its misfit is {gaps['before']['misfit']:.2f} ({EXPECTED_MISFIT})."
        )
        return text + _overstated_sd(facts["objective"], count) + prediction_warning(gaps["p_held_out"], held_out)
    worst = facts["worst"]
    text = data_notes + (
        f"The model disagrees with the {count} fitted measurements beyond what recalibration can explain "
        f"(global test {p_text(p)}), most strongly in the {worst['quantity']} at {worst['location']} "
        f"under {worst['condition']}. "
    )
    text += conflict_text("Recalibration has to move", answer["prior_conflicts"])
    excess = facts["noise_excess"]
    if not answer["named"] and excess is not None:
        return text + (
            f"No test finds a pattern in the residuals: the noise appears to be {excess:.2f} times as large as the "
            "stated standard deviations. Check the stated standard deviations; no effect is named."
        )
    if answer["outside_library"]:
        return text + _outside_library(answer, held_out)
    if not answer["named"]:
        text += f"No effect of the library explains this well enough to be named{_nearest(facts['likeliest'])}. "
    for number, effect in enumerate(answer["named"]):
        text += "The best explanation is " if number == 0 else "A further effect is "
        text += _named_effect(effect, facts["best"])
    return (text + _not_confirmed(answer) + _remaining(answer, held_out)).rstrip()


def _own_error(facts: Mapping) -> str:
    return (
        "What the test finds is within the errors that a model of this kind has "
        f"(probability that nothing is missing {facts['answer']['probabilities'][NOTHING]:.2f})."
    )


def _outside_library(answer: Mapping, held_out: list[str]) -> str:
    """State what speaks against the best candidates."""
    gaps, best, forms = answer["held_out"], answer["facts"]["best"], answer["facts"]["answer"]
    one, certainty = len(best) == 1, forms["probabilities"][OTHER]
    start = f"Something other than an effect of the library is missing (probability {certainty:.2f})"
    if not best:
        return f"{start}: {_shape_text(gaps)}"
    labels = listed([_label(effect) for effect in best])
    candidate = "the best candidate" if one else "the best candidates"
    change = (
        f"With {'it' if one else 'them'}, the misfit on {_held_out_text(answer)} "
        f"{misfit_change(gaps['before']['misfit'], gaps['after']['misfit'])}."
    )
    if answer["wiring_errors"]:
        errors = {(error["error"], error["place"]) for error in answer["wiring_errors"]}
        pairs = ", ".join(error["place"].replace("~", " and ") for error in answer["wiring_errors"])
        others = [_label(effect) for effect in best if (effect["effect"], effect["place"]) not in errors]
        text = (
            f"The measurements indicate a wiring error of the model, exchanged outlets: {pairs}. No effect is named; "
            "check whether each bed is attached to the correct vessel, and search again."
        )
        return text + (f" {_capitalised(listed(others))} may also be present." if others else "")
    implausible = [effect for effect in best if effect["implausible"]]
    if implausible:
        sizes = listed([f"{_label(effect)} ({size_text(effect['sizes'])})" for effect in implausible])
        reason = (
            f"{candidate} {'is' if one else 'are'} {labels}, but with an implausibly large size, more than "
            f"{RULE.implausible:.0f} standard deviations of its prior: {sizes}. No effect is named. {change}"
        )
    elif forms["leading_form"] == REROUTED:
        places = " and ".join(effect["place"] for effect in best if effect["effect"] == PROBE)
        reason = (
            f"gain errors of the flow probes at {places} would explain it, but their errors cancel. Flow rerouted "
            "between the branches, e.g. by swapped outlets, explains the same with a single cause, which the library "
            "does not contain. No effect is named."
        )
    elif forms["leading_form"] == VARYING and any(effect["varying"] for effect in best):
        reason = f"{varying_text(best)}. No effect is named. {change}"
    elif forms["leading_form"] == UNLISTED:
        reason = (
            f"{candidate} {'is' if one else 'are'} {labels}, but one linear response of the device that reads "
            f"{forms['device']}, of a shape that the library does not list, is likelier. No effect is named. {change}"
        )
    else:
        reason = (
            f"{candidate}, {labels}, {'leaves' if one else 'leave'} a misfit that {'its' if one else 'their'} law does "
            f"not have (probability of the name{'' if one else 's'} {forms['probabilities'][NAMES]:.2f}); "
            f"to a flexible error {'it adds' if one else 'they add'} {forms['support_nats']:.0f} nats of evidence. "
            f"{_capitalised(_shape_text(gaps))} {change}"
        )
    return f"{start}: {reason}"


def _shape_text(gaps: Mapping) -> str:
    return (
        f"with a flexible discrepancy the held-out misfit is {gaps['flexible']['misfit']:.2f} against "
        f"{gaps['before']['misfit']:.2f}. The residual waveforms show where it acts and its shape; no effect is named."
    )


def _named_effect(named: Mapping, best: Sequence[Mapping]) -> str:
    """Describe a named effect: probability, size, measurements that would distinguish its class, and doubts."""
    facts = next(e for e in best if (e["effect"], e["place"]) == (named["effect"], named["place"]))
    text = f"{_label(named)} ({class_probability_text(named['class'])}; {size_text(facts['sizes'])}). "
    text += next_measurement_text(named["next_measurements"]) + facts["assumption"]
    for size in facts["beyond_prior"]:
        text += (
            f"Its {size['label']} lies outside the central 99 % of its prior "
            f"({size['low']:.3g} to {size['high']:.3g}): {STAND_IN}"
        )
    if facts["varying"]:
        text += (
            "Its size differs when it is fitted to each condition separately "
            f"({sizes_by_condition(facts['varying'])}): "
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
    effects = [_label(effect) for effect in answer["not_confirmed"]]
    them = "it" if len(effects) == 1 else "them"
    return f"The fitted measurements also suggest {listed(effects)}, but the held-out data do not confirm {them}. "


def _remaining(answer: Mapping, held_out: list[str]) -> str:
    """State the change of the held-out misfit and what remains unexplained."""
    gaps, p, named = answer["held_out"], answer["remaining"]["p"], bool(answer["named"])
    before, after = gaps["before"], gaps["after"]
    text = f"On {_held_out_text(answer)} the misfit {misfit_change(before['misfit'], after['misfit'])}. "
    if named and not held_out:
        one = len(answer["held_out"]["conditions"]) == 1
        remedy = "measure another condition and hold it out" if one else "hold a condition out"
        text += f"This does not test the names, which were chosen using all conditions: {remedy} to test them. "
    if named and after[DENSITY] < before[DENSITY]:
        text += (
            "The held-out data are predicted worse with the named effects than with recalibration alone (log "
            f"predictive density per row {after[DENSITY]:.2f}, {before[DENSITY]:.2f}). "
        )
    if named and gaps["p_held_out"] < UNPREDICTED:
        text += f"The named effects do not predict all of the held-out data ({p_text(gaps['p_held_out'])}). "
    if answer["facts"]["unexplained"]:
        after, flexible, both = (gaps[model][DENSITY] for model in ("after", "flexible", "both"))
        text += f"Something remains unexplained ({p_text(p)}){flexible_text(after, flexible, both, named)}. "
    else:
        text += f"The remaining misfit is within the noise ({p_text(p)}). "
    if named:
        text += conflict_text("With the named effects, recalibration still moves", answer["prior_conflicts_remaining"])
    return text


def noise_notes(noise: Mapping[str, Mapping]) -> str:
    """Report waveform noise that is larger than stated, or correlated in time."""
    larger = [f"{name} by a factor of {one['scale']:.2f}" for name, one in noise.items() if not one["correlation_time"]]
    correlated = [
        f"{one['correlation_time']:.2g} s for {name}, {one['scale']:.2f} times the stated size"
        for name, one in noise.items()
        if one["correlation_time"]
    ]
    text = ""
    if larger:
        text += (
            "Waveforms, or the drives of the model, scatter more from sample to sample than their standard deviations "
            f"imply ({listed(larger)}); the standard deviations are scaled accordingly. "
        )
    if correlated:
        text += (
            f"The noise of waveforms is correlated in time (correlation time {listed(correlated)}), and is taken so. "
        )
    return text


def outlier_notes(outliers: Sequence[Mapping]) -> str:
    """Report single samples that lie far from both neighbours."""
    if not outliers:
        return ""
    samples = [
        "the {quantity} at {location} under {condition} at {time:.4g} s ({off:+.0f} standard deviations)".format(**one)
        for one in outliers[:MOST_LISTED]
    ]
    if len(outliers) > MOST_LISTED:
        samples.append(f"{len(outliers) - MOST_LISTED} more")
    if len(outliers) == 1:
        return f"One sample is an outlier and was left out: {samples[0]}. Check whether it is an artefact. "
    return (
        f"{len(outliers)} samples are outliers and were left out: {listed(samples)}. Check whether they are artefacts. "
    )


def _overstated_sd(objective: float, count: int) -> str:
    """Warn of standard deviations so large that they would hide any effect."""
    times = np.sqrt(objective / count)
    if times > QUIET or stats.chi2.cdf(objective, count) > UNLIKELY:
        return ""
    return (
        f" The residuals are only {times:.2g} times as large as the stated standard deviations, which would hide a "
        "missing effect: check that these are correct and in the unit of the values."
    )


def _nearest(candidate: Mapping | None) -> str:
    """Name the most probable candidate of the first round, if there is any."""
    if candidate is None:
        return ""
    probability = f"probability {candidate['probability']:.2f}, too low to be named"
    return f"; the best candidate is {_label(candidate)} ({probability})"


def prediction_warning(p: float, held_out: list[str]) -> str:
    """Warn that a model which agrees with the fitted data does not predict the held-out data, if so."""
    if p >= UNPREDICTED:
        return ""
    remedy = "check these conditions in the conditions file"
    if held_out:
        remedy += ", or hold other conditions out so that these are searched"
    return f" However, the model does not predict the held-out data ({p_text(p)}): {remedy}."


def class_probability_text(members: Sequence[Mapping]) -> str:
    """State the probability of a named effect and of the effects that are indistinguishable from it."""
    accepted, *others = members
    if not others:
        return f"probability {accepted['probability']:.2f}"
    total = sum(member["probability"] for member in members)
    names = ", ".join(f"{_label(member)} {member['probability']:.2f}" for member in others)
    return (
        f"probability {total:.2f} for its class, {accepted['probability']:.2f} for this member; indistinguishable from "
        f"it with these data: {names}"
    )


def worth_measuring(best_first: Sequence[Mapping]) -> list[Mapping]:
    """Return the measurements that would distinguish the members of a class, the best first."""
    return [one for one in best_first if one["expected_information_nats"] >= LEAST_INFORMATION]


def next_measurement_text(best_first: Sequence[Mapping]) -> str:
    """Name the measurement that would best distinguish the members of a class."""
    if not best_first:
        return ""
    informative = worth_measuring(best_first)
    if not informative:
        return "No mean pressure or flow of these vessels would distinguish them. "
    best = informative[0]
    what = f"The mean {best['quantity']} at {best['location']} under {best['condition']}"
    what += ", measured with another instrument," if best["already_measured"] else ""
    information = f"{best['expected_information_nats']:.2g} nats"
    return f"{what} would distinguish them best (expected information {information}). "


def varying_text(best: Sequence[Mapping]) -> str:
    """State which of the best candidates would need a different size under each condition."""
    sizes = [(_label(effect), sizes_by_condition(effect["varying"])) for effect in best if effect["varying"]]
    if len(best) == 1:
        ((label, text),) = sizes
        return f"the best candidate, {label}, would need a different size under each condition ({text})"
    which = listed([f"{label} ({text})" for label, text in sizes])
    labels = listed([_label(effect) for effect in best])
    return f"the best candidates are {labels}, of which {which} would need a different size under each condition"


def size_text(sizes: Sequence[Mapping]) -> str:
    """State the sizes of an effect with 90 % intervals."""
    return ", ".join(
        f"{'read early by' if size['early'] else size['meaning']} {_interval(size['value'], size['low'], size['high'])}"
        + " s" * size["early"]
        for size in sizes
    )


def sizes_by_condition(varying: Mapping) -> str:
    """State the first size of an effect under each condition that determines it, with 90 % intervals."""
    sizes = [f"{condition} {_interval(*values)}" for condition, values in varying["conditions"].items()]
    return f"{varying['label']}: {', '.join(sizes)} {varying['unit']}".rstrip()


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:.2g} ({low:.2g} to {high:.2g})"


def misfit_change(before: float, after: float) -> str:
    """Describe the change of the held-out misfit to two decimals."""
    if f"{before:.2f}" == f"{after:.2f}":
        return f"stays at {after:.2f} ({EXPECTED_MISFIT})"
    return f"{'falls' if after < before else 'rises'} from {before:.2f} to {after:.2f} ({EXPECTED_MISFIT})"


def flexible_text(after: float, flexible: float, both: float, named: bool) -> str:
    """State that a flexible discrepancy predicts the held-out data better, if it does.

    Parameters
    ----------
    after, flexible, both
        Log predictive density per row with the effects, with a flexible discrepancy, and with both.
    named
        Whether the effects are named.
    """
    if flexible <= after:
        return ""
    text = ": a flexible discrepancy predicts the held-out data better"
    if not named:
        return f"{text} (log predictive density per row {flexible:.2f}, without it {after:.2f})"
    densities = [after, flexible]
    text += " than the named effects alone"
    if both > flexible:
        text += ", and better still combined with them"
        densities.append(both)
    return f"{text} (log predictive density per row {', '.join(f'{density:.2f}' for density in densities)})"


def conflict_text(intro: str, conflicts: Sequence[Mapping]) -> str:
    """List the nuisance parameter in the worst conflict with its prior, and all far outside theirs."""
    shown = [one for n, one in enumerate(conflicts) if n == 0 or abs(one["moved"]) > RULE.distorted]
    if not shown:
        return ""
    first, *others = [*shown[:1], *sorted(shown[1:], key=lambda one: -abs(one["moved"]))][:MOST_LISTED]
    moved = f"{first['moved']:+.1f} standard deviations of its prior (×{first['factor']:.2g}, {p_text(first['p'])})"
    texts = [f"the {first['name']} by {moved}"]
    texts += [f"the {one['name']} by {one['moved']:+.1f} (×{one['factor']:.2g})" for one in others]
    if len(shown) > MOST_LISTED:
        texts.append(f"{len(shown) - MOST_LISTED} more")
    return f"{intro} {listed(texts)}. "


def listed(words: Sequence[str]) -> str:
    """Join words as in a sentence: a, b and c."""
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + list(words[-1:]))


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _label(effect: Mapping) -> str:
    return f"{effect['effect'].replace('_', ' ')} at {effect['place']}"


def p_text(p: float) -> str:
    """Format a p-value, including one too small for a float."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"


def _held_out(answer: Mapping) -> list[str]:
    """Return the conditions that were held out of every fit."""
    held_out = answer["held_out"]
    return held_out["conditions"] if held_out["scheme"] == "held out" else []


def _held_out_text(answer: Mapping) -> str:
    held_out = answer["held_out"]
    if held_out["scheme"] == "held out":
        return f"the held-out conditions ({', '.join(held_out['conditions'])})"
    return "each series, held out in turn," if held_out["scheme"] == "each series in turn" else EACH
