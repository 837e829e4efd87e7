"""Summary of a search as one paragraph of plain English."""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.locate import Located, PriorConflict
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.outliers import Outlier
from coronaryuq.discrepancy.selection.abstention import Gaps
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.flow_conservation import PROBE
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Parameter

Z_90 = 1.6448536269514722
"""Half-width of the central 90 % of a standard normal distribution."""
LEAST_INFORMATION = 0.1
"""Expected information (nats) below which a measurement does not distinguish a class; two equal members hold 0.69."""
EXPECTED_MISFIT = "1 is expected from noise and fit uncertainty"
QUIET, UNLIKELY = 0.5, 1e-4
"""Scatter over the stated standard deviation, and its probability, below which the latter is called too large."""
MOST_LISTED = 4
"""Maximum number of nuisance parameters or samples listed in one sentence."""
STAND_IN = "it may stand in for something that the library does not contain. "


def paragraph(
    discovery: Discovery, held_out: list[str], next_measurements: dict[tuple[str, str], list[dict]] | None = None
) -> str:
    """Summarise what disagrees, what is missing, how certain that is and how far the misfit falls.

    next_measurements: (effect, place) of a named effect → measurements that would distinguish its class, best first.
    """
    count = len(discovery.base.residual)
    located, level = discovery.located, discovery.problem.settings.alarm_level
    nuisances = discovery.problem.forward.nuisances
    data_notes = noise_notes(discovery.noise) + outlier_notes(discovery.outliers)
    if not discovery.alarm:
        text = data_notes + (
            f"After recalibration within its priors, the model agrees with the {count} fitted measurements "
            f"(global test {p_text(located.p)}): there is nothing to explain. "
            f"On {_held_out_text(held_out)} its misfit is {discovery.gaps.before.misfit:.2f} ({EXPECTED_MISFIT})."
        )
        return text + _overstated_sd(discovery) + prediction_warning(discovery.verdict.predictive_p, held_out)
    worst = located.groups[0]
    text = data_notes + (
        f"The model disagrees with the {count} fitted measurements beyond what recalibration can explain "
        f"(global test {p_text(located.p)}), most strongly in the {worst.quantity} at {worst.location} "
        f"under {worst.condition}. "
    )
    text += conflict_text("Recalibration has to move", prior_conflicts(located, nuisances, level))
    if not discovery.named:
        excess = noise_excess(located, discovery.base.objective / count, level)
        if excess is not None:
            return text + (
                f"No test finds a pattern in the residuals: the noise appears to be {excess:.2f} times as large as the "
                "stated standard deviations. Check whether they are those of the measurements; no effect is named."
            )
    if discovery.outside_library:
        return text + _outside_library(discovery, held_out)
    if not discovery.named:
        text += f"No effect of the library explains this well enough to be named{_nearest(discovery.rounds)}. "
    for number, entry in enumerate(discovery.named):
        _, placed = _accepted(entry)
        best_first = (next_measurements or {}).get((placed.effect.name, placed.place), [])
        text += f"{'Missing' if number == 0 else 'Also missing'} is {_named_effect(discovery, entry, best_first)}"
    return (text + _not_confirmed(discovery) + _remaining(discovery, held_out)).rstrip()


def _accepted(entry: Round) -> tuple[Candidate, PlacedEffect]:
    assert entry.accepted is not None, "the round named no effect"
    return entry.accepted, entry.accepted.placed


def _outside_library(discovery: Discovery, held_out: list[str]) -> str:
    """Explain why the best candidates are not named."""
    gaps, verdict, anatomy = discovery.gaps, discovery.verdict, discovery.problem.forward.anatomy
    labels = [_label(placed) for placed in discovery.hypothesis]
    one = len(labels) == 1
    best, candidate = listed(labels), "the best candidate" if one else "the best candidates"
    change = (
        f"With {'it' if one else 'them'}, the misfit on {_held_out_text(held_out)} "
        f"{misfit_change(gaps.before.misfit, gaps.after.misfit)}."
    )
    if verdict.mistaken:
        pairs = ", ".join(place.replace("~", " and ") for _, place in verdict.mistaken)
        others = [_label(placed) for placed in discovery.hypothesis if placed not in verdict.mistaken]
        text = (
            f"The measurements look as if outlets had been exchanged in the model: {pairs}. That is not an effect of "
            "the library, and no effect is named; check whether each bed is at its own vessel, and search again."
        )
        return text + (f" {_capitalised(listed(others))} may also be present." if others else "")
    if verdict.redistributed:
        places = " and ".join(place for effect, place in discovery.hypothesis if effect.name == PROBE)
        return (
            f"Errors of the flow probes at {places} would explain it, but one reads too high by what the other reads "
            "too low. Blood that takes another path than in the network, as through exchanged or wrongly connected "
            "outlets, explains the same with a single cause, which the library does not contain. No effect is named."
        )
    if verdict.refuted:
        reason = (
            f"{candidate} for the fitted measurements, {best}, {'is' if one else 'are'} not confirmed by the "
            "held-out data "
            f"(log predictive density per row {gaps.after.lpd:.3f}, with recalibration alone {gaps.before.lpd:.3f}). "
            "No effect is named."
        )
    elif discovery.implausible:
        implausible = listed(
            [
                f"{_label(placed)} ({size_text(placed, discovery.sizes(placed), anatomy)})"
                for placed in discovery.implausible
            ]
        )
        reason = (
            f"{candidate} {'is' if one else 'are'} {best}, but with an implausibly large size, more than "
            f"{RULE.implausible:.0f} standard "
            f"deviations of its prior: {implausible}. No effect is named. {change}"
        )
    elif verdict.varying:
        reason = f"{varying_text(discovery.hypothesis, verdict.varying, anatomy)}. No effect is named. {change}"
    elif verdict.unpredicted:
        reason = (
            f"{candidate} for the fitted measurements, {best}, {'does' if one else 'do'} not predict the held-out data "
            f"({p_text(verdict.predictive_p)}). No effect is named. {change}"
        )
    else:
        reason = (
            "a flexible discrepancy predicts the held-out data clearly better than every candidate "
            f"(misfit {gaps.flexible.misfit:.2f} against {gaps.after.misfit:.2f}). The residual waveforms "
            "show where the missing effect acts and its shape; no effect is named."
        )
    return f"No effect of the library explains this: {reason}"


def _named_effect(discovery: Discovery, entry: Round, next_measurements: list[dict]) -> str:
    """Describe a named effect: probability, size, measurements that would distinguish its class, and doubts."""
    (_, placed), anatomy = _accepted(entry), discovery.problem.forward.anatomy
    effect = placed.effect
    text = f"{_label(placed)} ({class_probability_text(entry.members)}; "
    text += f"{size_text(placed, discovery.sizes(placed), anatomy)}). "
    text += next_measurement_text(next_measurements)
    text += effect.assumption(anatomy, [c.covariates for c in discovery.problem.forward.conditions.values()])
    for parameter in discovery.beyond_prior(placed):
        bounds = (float(parameter.from_standard(k * RULE.prior_bound)) for k in (-1, 1))
        low, high = sorted(effect.describe(parameter, bound, anatomy)[1] for bound in bounds)
        text += (
            f"Its {_size_label(placed, parameter, anatomy)} lies outside the central 99 % of its prior "
            f"({low:.3g} to {high:.3g}): {STAND_IN}"
        )
    for varying in (v for v in discovery.verdict.varying if v.placed == placed):
        text += (
            "Its size differs when it is fitted to each condition separately "
            f"({sizes_by_condition(varying, anatomy)}): "
            f"it may change between conditions, or {STAND_IN.removeprefix('it may ')}"
        )
    if entry.held_out_gain is not None and entry.held_out_gain < 0.0:
        loss = f"{-entry.held_out_gain:.2g} nats in total"
        text += f"The held-out data are predicted better without it (by {loss}): {STAND_IN}"
    return text


def _not_confirmed(discovery: Discovery) -> str:
    """List effects that the fitted measurements ask for and the held-out data do not confirm."""
    if not (discovery.named and discovery.unconfirmed):
        return ""
    effects = [_label(placed) for placed in discovery.unconfirmed]
    them = "it" if len(effects) == 1 else "them"
    return f"The fitted measurements also suggest {listed(effects)}, but the held-out data do not confirm {them}. "


def _remaining(discovery: Discovery, held_out: list[str]) -> str:
    """Tell how far the held-out misfit has fallen, and what remains unexplained."""
    gaps, remaining, named = discovery.gaps, discovery.remaining, bool(discovery.named)
    level = discovery.problem.settings.alarm_level
    text = f"On {_held_out_text(held_out)} the misfit {misfit_change(gaps.before.misfit, gaps.after.misfit)}. "
    if named and not held_out:
        text += (
            "This does not test the names, which were chosen using all conditions: hold a condition out to test them. "
        )
    if named and gaps.after.total_lpd < gaps.before.total_lpd:
        text += (
            "The held-out data are predicted worse with the named effects than with recalibration alone (log "
            "predictive "
            f"density per row {gaps.after.lpd:.2f}, {gaps.before.lpd:.2f}). "
        )
    if named and discovery.verdict.unpredicted:
        text += (
            f"The named effects do not predict all of the held-out data ({p_text(discovery.verdict.predictive_p)}). "
        )
    if remaining.alarm(level):
        text += f"Something remains unexplained ({p_text(remaining.p)}){flexible_text(gaps, named)}. "
    else:
        text += f"The remaining misfit is within the noise ({p_text(remaining.p)}). "
    if named:
        conflicts = prior_conflicts(remaining, discovery.problem.forward.nuisances, level)
        text += conflict_text("With the named effects, recalibration still moves", conflicts)
    return text


def noise_notes(noise: dict[str, Noise]) -> str:
    """Report waveform noise that is larger than stated, or correlated in time."""
    larger = [f"{name} by a factor of {one.scatter:.2f}" for name, one in noise.items() if not one.lasting]
    correlated = [f"{one.lasting:.2g} s for {name}" for name, one in noise.items() if one.lasting]
    text = ""
    if larger:
        text += (
            "Waveforms, or the drives of the model, scatter more from sample to sample than their standard deviations "
            f"imply ({listed(larger)}); the standard deviations are scaled accordingly. "
        )
    if correlated:
        text += (
            "Waveforms scatter less from sample to sample than their standard deviations imply; their noise is taken "
            f"to be correlated in time (correlation time {listed(correlated)}). "
        )
    return text


def outlier_notes(outliers: list[Outlier]) -> str:
    """Report single samples that lie far from both neighbours."""
    if not outliers:
        return ""
    samples = [
        f"the {one.quantity} at {one.location} under {one.condition} at {one.time:.4g} s "
        f"({one.off:+.0f} standard deviations)"
        for one in outliers[:MOST_LISTED]
    ]
    if len(outliers) > MOST_LISTED:
        samples.append(f"{len(outliers) - MOST_LISTED} more")
    if len(outliers) == 1:
        return f"One sample is an outlier, {samples[0]}: check whether it is an artefact and remove it. "
    return (
        f"{len(outliers)} samples are outliers, {listed(samples)}: check whether they are artefacts and remove them. "
    )


def _overstated_sd(discovery: Discovery) -> str:
    """Warn of standard deviations so large that they would hide any effect."""
    count = len(discovery.base.residual)
    times = np.sqrt(discovery.base.objective / count)
    if times > QUIET or stats.chi2.cdf(discovery.base.objective, count) > UNLIKELY:
        return ""
    return (
        f" The residuals are only {times:.2g} times as large as the stated standard deviations, which would hide a "
        "missing effect: check that these are correct and in the unit of the values."
    )


def _nearest(rounds: Sequence[Round]) -> str:
    """Name the most probable candidate of the first round if it is more probable than no effect."""
    tried = [entry for entry in rounds[:1] if entry.shortlist]
    if not tried:
        return ""
    best = max(tried[0].shortlist, key=lambda c: c.probability)
    if best.probability <= tried[0].probabilities["none"]:
        return ""
    return f"; the best candidate is {_label(best.placed)} (probability {best.probability:.2f}, too low to be named)"


def prediction_warning(p: float, held_out: list[str]) -> str:
    """Warn that a model which agrees with the fitted data does not predict the held-out data, if so."""
    if p >= RULE.unpredicted:
        return ""
    remedy = "check these conditions in the conditions file"
    if held_out:
        remedy += ", or hold other conditions out so that these are searched"
    return f" However, the model does not predict the held-out data ({p_text(p)}): {remedy}."


def class_probability_text(members: Sequence[Candidate]) -> str:
    """State the probability of a named effect and of the effects that are indistinguishable from it."""
    accepted, *others = members
    if not others:
        return f"probability {accepted.probability:.2f}"
    total = sum(member.probability for member in members)
    names = ", ".join(f"{_label(member.placed)} {member.probability:.2f}" for member in others)
    return (
        f"probability {total:.2f} for its class, {accepted.probability:.2f} for this member; indistinguishable from it "
        f"with these data: {names}"
    )


def next_measurement_text(best_first: list[dict]) -> str:
    """Name the measurement that would best distinguish the members of a class."""
    if not best_first:
        return ""
    best = best_first[0]
    if best["expected_information_nats"] < LEAST_INFORMATION:
        return "No mean pressure or flow of these vessels would distinguish them. "
    what = f"The mean {best['quantity']} at {best['location']} under {best['condition']}"
    what += ", measured with another instrument," if best["already_measured"] else ""
    information = f"{best['expected_information_nats']:.2g} nats"
    return f"{what} would distinguish them best (expected information {information}). "


def varying_text(hypothesis: Hypothesis, varying: list[Constancy], anatomy: Anatomy) -> str:
    """Tell which of the best candidates would need a different size under each condition."""
    sizes = [(_label(one.placed), sizes_by_condition(one, anatomy)) for one in varying]
    if len(hypothesis) == 1:
        best, text = _label(*hypothesis), sizes[0][1]
        return f"the best candidate, {best}, would need a different size under each condition ({text})"
    which = listed([f"{name} ({text})" for name, text in sizes])
    best = listed([_label(placed) for placed in hypothesis])
    return f"the best candidates are {best}, of which {which} would need a different size under each condition"


def size_text(placed: PlacedEffect, sizes: list[tuple[Parameter, float, float]], anatomy: Anatomy) -> str:
    """State the sizes of an effect, (parameter, z, standard deviation of z), with 90 % intervals."""
    texts, effect = [], placed.effect
    for parameter, z, sd in sizes:
        values = _with_interval(parameter, z, sd)
        meaning, _ = effect.describe(parameter, values[0], anatomy)
        values = [effect.describe(parameter, value, anatomy)[1] for value in values]
        early = effect.side == "measurement" and parameter.name == "delay" and values[0] < 0.0
        if early:
            values = [-values[0], -values[2], -values[1]]
        size, low, high = (f"{value:.2g}" for value in values)
        texts.append(f"{'read early by' if early else meaning} {size} ({low} to {high})" + " s" * early)
    return ", ".join(texts)


def _with_interval(parameter: Parameter, z: float, sd: float) -> list[float]:
    """Size at z and at the ends of its 90 % interval."""
    return [float(parameter.from_standard(z + k * sd)) for k in (0.0, -Z_90, Z_90)]


def noise_excess(located: Located, mean_square: float, level: float) -> float | None:
    """Return the noise over its stated size if residuals are too large but no other test rejects, else None."""
    if any(p < level for name, p in located.tests.items() if name != "all residuals"):
        return None
    return float(np.sqrt(mean_square))


def misfit_change(before: float, after: float) -> str:
    """Describe the change of the held-out misfit to two decimals."""
    if f"{before:.2f}" == f"{after:.2f}":
        return f"stays at {after:.2f} ({EXPECTED_MISFIT})"
    return f"{'falls' if after < before else 'rises'} from {before:.2f} to {after:.2f} ({EXPECTED_MISFIT})"


def flexible_text(gaps: Gaps, named: bool) -> str:
    """Tell that a flexible discrepancy predicts the held-out data better, if it does."""
    if gaps.flexible.total_lpd <= gaps.after.total_lpd:
        return ""
    text = ": a flexible discrepancy predicts the held-out data better"
    if not named:
        return f"{text} (log predictive density per row {gaps.flexible.lpd:.2f}, without it {gaps.after.lpd:.2f})"
    densities = [gaps.after.lpd, gaps.flexible.lpd]
    text += " than the named effects alone"
    if gaps.both.total_lpd > gaps.flexible.total_lpd:
        text += ", and better still combined with them"
        densities.append(gaps.both.lpd)
    return f"{text} (log predictive density per row {', '.join(f'{density:.2f}' for density in densities)})"


def prior_conflicts(located: Located, nuisances: list[Nuisance], level: float) -> list[tuple[PriorConflict, float]]:
    """Return nuisance parameters in conflict with their prior at `level` or far outside it, with their factors."""
    sd = {nuisance.name: nuisance.sd for nuisance in nuisances}
    conflicts = [one for one in located.conflicts if one.p < level or abs(one.moved) > RULE.distorted]
    return [(one, float(np.exp(sd[one.name] * one.moved))) for one in conflicts]


def conflict_text(intro: str, conflicts: list[tuple[PriorConflict, float]]) -> str:
    """List the nuisance parameter in the worst conflict with its prior, and all far outside theirs."""
    shown = [one for n, one in enumerate(conflicts) if n == 0 or abs(one[0].moved) > RULE.distorted]
    if not shown:
        return ""
    (first, factor), *others = [*shown[:1], *sorted(shown[1:], key=lambda one: -abs(one[0].moved))][:MOST_LISTED]
    moved = f"{first.moved:+.1f} standard deviations of its prior (×{factor:.2g}, {p_text(first.p)})"
    texts = [f"the {first.name} by {moved}"]
    texts += [f"the {one.name} by {one.moved:+.1f} (×{factor:.2g})" for one, factor in others]
    if len(shown) > MOST_LISTED:
        texts.append(f"{len(shown) - MOST_LISTED} more")
    return f"{intro} {listed(texts)}. "


def listed(words: Sequence[str]) -> str:
    """Join words as in a sentence: a, b and c."""
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + list(words[-1:]))


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _label(placed: PlacedEffect) -> str:
    effect, place = placed
    return f"{effect.name.replace('_', ' ')} at {place}"


def sizes_by_condition(varying: Constancy, anatomy: Anatomy) -> str:
    """State the first size under each condition that determines it, with 90 % intervals."""
    effect = varying.placed.effect
    parameter, texts = effect.parameters[0], []
    for condition, (mean, sd) in varying.known.items():
        size, low, high = (
            f"{effect.describe(parameter, value, anatomy)[1]:.2g}" for value in _with_interval(parameter, mean, sd)
        )
        texts.append(f"{condition} {size} ({low} to {high})")
    unit = f" {parameter.unit}" * (parameter.unit != "1")
    return f"{_size_label(varying.placed, parameter, anatomy)}: {', '.join(texts)}{unit}"


def _size_label(placed: PlacedEffect, parameter: Parameter, anatomy: Anatomy) -> str:
    """Short name of a size: the parameter's name, unless the effect describes it differently in this network."""
    meaning, _ = placed.effect.describe(parameter, float(parameter.from_standard(0.0)), anatomy)
    return parameter.name.replace("_", " ") if meaning == parameter.meaning else meaning


def p_text(p: float) -> str:
    """Format a p-value, including one too small for a float."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"


def _held_out_text(held_out: list[str]) -> str:
    if held_out:
        return f"the held-out conditions ({', '.join(held_out)})"
    return "each condition, held out in turn,"
