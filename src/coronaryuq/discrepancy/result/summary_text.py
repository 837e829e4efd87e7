"""One paragraph in plain words about what was found, for the report."""

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.forward.simulation import Acting
from coronaryuq.discrepancy.inference.locate import Located, Strain
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.outliers import Spike
from coronaryuq.discrepancy.inference.problem import DISTORTED
from coronaryuq.discrepancy.selection.abstention import FAR_OUT, LEAST_FORETOLD, Gaps
from coronaryuq.discrepancy.selection.flow_conservation import PROBE
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.search import CENTRAL_99, Discovery
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Parameter

Z_90 = 1.6448536269514722
"""Standard deviations of a normal distribution that bound its central 90 %."""
LEAST_INFORMATION = 0.1
"""Nats of expected information below which a measurement tells nothing apart; a class of two holds 0.69."""
FLOOR = "1 is what noise and the fit's own spread let expect"
QUIET, UNLIKELY = 0.5, 1e-4
"""Scatter, over the standard deviations that are said, and its chance, below which these are too large."""
MOST_LISTED = 4
"""Nuisance parameters, or samples, listed at most in one sentence."""


def paragraph(
    found: Discovery, held_out: list[str], separating: dict[tuple[str, str], list[dict]] | None = None
) -> str:
    """What disagrees, what is missing, how sure, how far the gap shrinks; or that there is nothing to explain.

    separating: of named effects, by name and place, the measurements that would split their class, the best first.
    """
    count = len(found.base.residual)
    of_the_data = _scattered(found.noise) + _standing_out(found.spikes)
    if not found.alarm:
        text = of_the_data + (
            f"The model, recalibrated within its priors, agrees with the {count} fitted measurements "
            f"(global test {chance(found.located.p)}): there is nothing to explain. "
            f"On {_kept(held_out)} its misfit is {found.gaps.before.misfit:.2f} ({FLOOR})."
        )
        return text + _quiet(found) + _unforeseen(found.verdict.foretold, held_out)
    worst = found.located.groups[0]
    text = of_the_data + (
        f"The model disagrees with the {count} fitted measurements beyond what recalibration can mend "
        f"(global test {chance(found.located.p)}), most in the {worst.quantity} at {worst.location} "
        f"under {worst.condition}. "
    )
    text += _strained("Recalibration has to move", found.located, found)
    larger = shapeless(found)
    if larger is not None and not found.named:
        return text + (
            "What disagrees has no shape that a test sees: the noise looks "
            f"{larger:.2f} times as large as the standard deviations say. See whether they are those of the "
            "measurements; nothing is named."
        )
    reason = _why_not_named(found, held_out)
    if reason:
        return text + reason
    if not found.named:
        text += f"No effect of the library explains it well enough to be named{_nearest(found)}. "
    for number, entry in enumerate(found.named):
        by = (separating or {}).get((entry.accepted.effect.name, entry.accepted.place), [])
        text += f"{'Missing' if number == 0 else 'Also missing'} is {_described(found, entry, by)}"
    return (text + _not_borne_out(found) + _afterwards(found, held_out)).rstrip()


def _why_not_named(found: Discovery, held_out: list[str]) -> str:
    """Why nothing is named of what came nearest, where the answer is outside the library; else nothing."""
    if not found.outside_library:
        return ""
    gaps, verdict = found.gaps, found.verdict
    nearest = listed([_called(one) for one in found.acting])
    went = f"With it the misfit on {_kept(held_out)} {moved(gaps.before.misfit, gaps.after.misfit)}."
    if verdict.mistaken:
        pairs = ", ".join(place.replace("~", " and ") for _, place in verdict.mistaken)
        beside = [_called(one) for one in found.acting if one not in verdict.mistaken]
        text = (
            f"The measurements look as if outlets had been exchanged in the model: {pairs}. That is no effect of the "
            "library, and nothing is named; see whether each bed is at its own vessel, and search again."
        )
        return text + (f" Beside it there may be {' and '.join(beside)}." if beside else "")
    if verdict.redistributed:
        places = " and ".join(place for effect, place in found.acting if effect.name == PROBE)
        return (
            f"Flow probes off at {places} would explain it, but what one reads too much the other reads too little: "
            "blood that goes elsewhere than the network says, as through swapped or wrongly wired outlets, explains "
            "the same with one cause, which the library does not have. It is not named."
        )
    if verdict.refuted:
        reason = (
            f"what comes nearest in the fitted measurements, {nearest}, is not borne out by those that no fit had seen "
            f"(log predictive density per row {gaps.after.lpd:.3f}, of recalibration alone {gaps.before.lpd:.3f}). "
            "Nothing is named."
        )
    elif found.far_out:
        told = listed([f"{_called(one)} ({_size_of(found, one)})" for one in found.far_out])
        reason = (
            f"what comes nearest is {nearest}, with a size more than {FAR_OUT:.0f} standard deviations of its prior "
            f"away from it: {told}. Nothing is named. {went}"
        )
    elif verdict.varying:
        reason = f"{_varying(found)}. Nothing is named. {went}"
    elif verdict.unforeseen:
        reason = (
            f"what comes nearest in the fitted measurements, {nearest}, does not foretell those that no fit had seen "
            f"({chance(verdict.foretold)}). Nothing is named. {went}"
        )
    else:
        reason = (
            "a flexible discrepancy predicts measurements that no fit had seen clearly better than every named "
            f"candidate (misfit {gaps.flexible.misfit:.2f} against {gaps.after.misfit:.2f}). The residual waveforms "
            "show where it acts and its shape; it is not named."
        )
    return f"No effect of the library explains it: {reason}"


def _described(found: Discovery, entry: Round, separating: list[dict]) -> str:
    """A named effect: how sure, how large, what would split its class, and what puts it in doubt."""
    one, anatomy = entry.accepted, found.problem.forward.anatomy
    text = f"{_called(one.acting)} ({_probability(entry)}; {_size_of(found, one.acting)}). "
    text += _told_apart(separating)
    text += one.effect.assumed(anatomy, [c.covariates for c in found.problem.forward.conditions.values()])
    for parameter in found.beyond_prior(one.acting):
        bounds = (float(parameter.from_standard(k * CENTRAL_99)) for k in (-1, 1))
        low, high = sorted(one.effect.said(parameter, bound, anatomy)[1] for bound in bounds)
        text += (
            f"Its {_label(one.acting, parameter, anatomy)} lies beyond the central 99 % of what is thought possible "
            f"({low:.3g} to {high:.3g}): it may stand for something that the library does not have. "
        )
    for varying in (v for v in found.verdict.varying if v.acting == one.acting):
        text += (
            f"Fitted to each condition by itself its size differs ({_sizes(varying, anatomy)}): it may change, or "
            "stand for something that the library does not have. "
        )
    if entry.held_out is not None and entry.held_out < 0.0:
        text += (
            f"Measurements that no fit had seen are predicted better without it (by {-entry.held_out:.2g} nats in "
            "all): it may stand for something that the library does not have. "
        )
    return text


def _not_borne_out(found: Discovery) -> str:
    """Effects that the fitted measurements alone ask for, beside named ones."""
    if not (found.named and found.not_borne_out):
        return ""
    those = "it" if len(found.named) == 1 else "them"
    wanted = listed([_called(one) for one in found.not_borne_out])
    return (
        f"Beside {those} the fitted measurements ask for {wanted}, too, which those that no fit had seen do not bear "
        "out: not named. "
    )


def _afterwards(found: Discovery, held_out: list[str]) -> str:
    """How far the gap has closed, and what is left."""
    gaps = found.gaps
    text = f"On {_kept(held_out)} the misfit {moved(gaps.before.misfit, gaps.after.misfit)}. "
    if found.named and not held_out:
        text += "That is no test of the names, which were chosen with all of them: hold a condition out for one. "
    if found.named and gaps.after.total_lpd < gaps.before.total_lpd:
        text += (
            "Those measurements are predicted worse with the named effects than by recalibration alone (log predictive "
            f"density per row {gaps.after.lpd:.2f}, {gaps.before.lpd:.2f}). "
        )
    if found.named and found.verdict.unforeseen:
        text += f"Not all of those are as the named effects foretell them ({chance(found.verdict.foretold)}). "
    if found.remaining.alarm(found.problem.settings.alarm_level):
        text += f"Something remains unexplained ({chance(found.remaining.p)}){rival(gaps, bool(found.named))}. "
    else:
        text += f"What remains is within the noise ({chance(found.remaining.p)}). "
    if found.named:
        text += _strained("With the named effects recalibration still moves", found.remaining, found)
    return text


def _scattered(noise: dict[str, Noise]) -> str:
    """That waveforms are noisier than is said, or their noise lasts, where it is so."""
    larger = [f"those of {name} {one.scatter:.2f} times" for name, one in noise.items() if not one.lasting]
    lasting = [f"{one.lasting:.2g} s of {name}" for name, one in noise.items() if one.lasting]
    text = ""
    if larger:
        text += (
            "Waveforms scatter more from one sample to the next than their standard deviations say "
            f"({listed(larger)}), or a drive of the model does, and are taken to be so much less certain. "
        )
    if lasting:
        text += (
            "Waveforms scatter less from one sample to the next than their standard deviations say: their noise is "
            f"taken to last (for {listed(lasting)}). "
        )
    return text


def _standing_out(found: list[Spike]) -> str:
    """Samples that stand out by themselves, where there are any."""
    if not found:
        return ""
    said = []
    for one in found[:MOST_LISTED]:
        where = f"{one.quantity} at {one.location} under {one.condition} at {one.time:.4g} s"
        said.append(f"the {where} ({one.off:+.0f} standard deviations)")
    if len(found) > MOST_LISTED:
        said.append(f"{len(found) - MOST_LISTED} more")
    if len(found) == 1:
        return f"Off both neighbours is {said[0]}: see whether that is an artefact, and leave it out. "
    return f"Off both neighbours are {listed(said)}: see whether those are artefacts, and leave them out. "


def _quiet(found: Discovery) -> str:
    """That measurements scatter far less than their standard deviations say, so that hardly anything would be seen."""
    count = len(found.base.residual)
    times = np.sqrt(found.base.objective / count)
    if times > QUIET or stats.chi2.cdf(found.base.objective, count) > UNLIKELY:
        return ""
    return (
        f" The measurements scatter about it only {times:.2g} times as much as their standard deviations say, which "
        "would hide what is missing: see whether those are right, and in the unit of the values."
    )


def _nearest(found: Discovery) -> str:
    """What has the highest probability where nothing is named, if it is likelier than nothing."""
    tried = [entry for entry in found.rounds[:1] if entry.shortlist]
    if not tried:
        return ""
    best = max(tried[0].shortlist, key=lambda c: c.probability)
    if best.probability <= tried[0].probabilities["none"]:
        return ""
    return f"; nearest comes {_called(best.acting)} (probability {best.probability:.2f}, too little by itself)"


def _unforeseen(foretold: float, held_out: list[str]) -> str:
    """That a model which agrees with what was fitted does not foretell the rest, where it does not."""
    if foretold >= LEAST_FORETOLD:
        return ""
    remedy = "see what the conditions file says of them"
    if held_out:
        remedy += ", or keep others out instead, to have these searched"
    return f" But those measurements are not as the model foretells them ({chance(foretold)}): {remedy}."


def _probability(entry: Round) -> str:
    """How probable a named effect is and, where the data cannot tell it from others, how probable each of them."""
    one, *others = entry.members
    if not others:
        return f"probability {one.probability:.2f}"
    share = sum(member.probability for member in entry.members)
    told = ", ".join(f"{_called(member.acting)} {member.probability:.2f}" for member in others)
    return (
        f"probability of the class {share:.2f}, of this member {one.probability:.2f}; the others, which these data "
        f"cannot tell from it: {told}"
    )


def _told_apart(by: list[dict]) -> str:
    """Which further measurement would split a class, if any."""
    if not by:
        return ""
    best = by[0]
    if best["expected_information_nats"] < LEAST_INFORMATION:
        return "No mean pressure or flow of these vessels would tell them apart. "
    what = f"The mean {best['quantity']} at {best['location']} under {best['condition']}"
    what += ", read by another instrument," if best["already_measured"] else ""
    return f"{what} would tell them apart best ({best['expected_information_nats']:.2g} nats are expected of it). "


def _varying(found: Discovery) -> str:
    """What comes nearest, and which of it would need sizes of its own under the conditions."""
    nearest = [_called(one) for one in found.acting]
    anatomy = found.problem.forward.anatomy
    told = [(_called(one.acting), _sizes(one, anatomy)) for one in found.verdict.varying]
    if len(nearest) == 1:
        return f"what comes nearest, {nearest[0]}, would need another size under each condition ({told[0][1]})"
    which = listed([f"{name} ({sizes})" for name, sizes in told])
    return f"what comes nearest is {listed(nearest)}, of which {which} would need another size under each condition"


def _size_of(found: Discovery, acting: Acting) -> str:
    """What the sizes of a named effect are, with their 90 % intervals."""
    told, anatomy = [], found.problem.forward.anatomy
    for parameter, z, sd in found.sizes(acting):
        sizes = [float(parameter.from_standard(z + k * sd)) for k in (0.0, -Z_90, Z_90)]
        meaning, _ = acting[0].said(parameter, sizes[0], anatomy)
        sizes = [acting[0].said(parameter, size, anatomy)[1] for size in sizes]
        early = acting[0].side == "measurement" and parameter.name == "delay" and sizes[0] < 0.0
        if early:
            sizes = [-sizes[0], -sizes[2], -sizes[1]]
        size, low, high = (f"{value:.2g}" for value in sizes)
        told.append(f"{'read early by' if early else meaning} {size} ({low} to {high})" + " s" * early)
    return ", ".join(told)


def shapeless(found: Discovery) -> float | None:
    """How much larger than said the noise looks, where residuals are too large and no other test sees anything."""
    level, tests = found.problem.settings.alarm_level, found.located.tests
    if any(p < level for name, p in tests.items() if name != "all residuals"):
        return None
    return float(np.sqrt(found.base.objective / len(found.base.residual)))


def moved(before: float, after: float) -> str:
    """How the misfit on held-out measurements changes, as far as two decimals tell."""
    if f"{before:.2f}" == f"{after:.2f}":
        return f"stays at {after:.2f} ({FLOOR})"
    return f"{'falls' if after < before else 'rises'} from {before:.2f} to {after:.2f} ({FLOOR})"


def rival(gaps: Gaps, named: bool) -> str:
    """That a flexible discrepancy predicts held-out measurements better, where it does."""
    if gaps.flexible.total_lpd <= gaps.after.total_lpd:
        return ""
    told = ": a flexible discrepancy predicts those measurements better"
    if not named:
        return f"{told} (log predictive density per row {gaps.flexible.lpd:.2f}, without it {gaps.after.lpd:.2f})"
    densities = [gaps.after.lpd, gaps.flexible.lpd]
    told += " than the named effects alone"
    if gaps.both.total_lpd > gaps.flexible.total_lpd:
        told += ", and better still together with them"
        densities.append(gaps.both.lpd)
    return f"{told} (log predictive density per row {', '.join(f'{density:.2f}' for density in densities)})"


def strained(located: Located, found: Discovery) -> list[tuple[Strain, float]]:
    """Nuisance parameters that are in conflict with their prior or far outside it, each with the factor that it is."""
    sd = {nuisance.name: nuisance.sd for nuisance in found.problem.forward.nuisances}
    level = found.problem.settings.alarm_level
    away = [one for one in located.strains if one.p < level or abs(one.moved) > DISTORTED]
    return [(one, float(np.exp(sd[one.name] * one.moved))) for one in away]


def _strained(said: str, located: Located, found: Discovery) -> str:
    """The nuisance parameter in the worst conflict with its prior, and all far outside theirs, where there are any."""
    away = [one for n, one in enumerate(strained(located, found)) if n == 0 or abs(one[0].moved) > DISTORTED]
    if not away:
        return ""
    (first, factor), *others = [*away[:1], *sorted(away[1:], key=lambda one: -abs(one[0].moved))][:MOST_LISTED]
    moved = f"{first.moved:+.1f} standard deviations of its prior (×{factor:.2g}, {chance(first.p)})"
    told = [f"the {first.name} by {moved}"]
    told += [f"the {one.name} by {one.moved:+.1f} (×{factor:.2g})" for one, factor in others]
    if len(away) > MOST_LISTED:
        told.append(f"{len(away) - MOST_LISTED} more")
    return f"{said} {listed(told)}. "


def listed(words: list[str]) -> str:
    """Words as one reads them out: a, b and c."""
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + words[-1:])


def _called(acting: Acting) -> str:
    effect, place = acting
    return f"{effect.name.replace('_', ' ')} at {place}"


def _sizes(one: Constancy, anatomy: Anatomy) -> str:
    """The first size under the conditions that tell of it, as it is said, with 90 % intervals."""
    parameter, told = one.acting[0].parameters[0], []
    for name, (mean, sd) in one.known.items():
        values = [float(parameter.from_standard(mean + k * sd)) for k in (0.0, -Z_90, Z_90)]
        size, low, high = (f"{one.acting[0].said(parameter, value, anatomy)[1]:.2g}" for value in values)
        told.append(f"{name} {size} ({low} to {high})")
    return f"{_label(one.acting, parameter, anatomy)}: {', '.join(told)}" + (
        f" {parameter.unit}" * (parameter.unit != "1")
    )


def _label(acting: Acting, parameter: Parameter, anatomy: Anatomy) -> str:
    """What a size is called where there is little room: its name, or what it is said to be instead of its meaning."""
    meaning, _ = acting[0].said(parameter, float(parameter.from_standard(0.0)), anatomy)
    return parameter.name.replace("_", " ") if meaning == parameter.meaning else meaning


def chance(p: float) -> str:
    """A p-value in words, where it is too small for a number too."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"


def _kept(held_out: list[str]) -> str:
    if held_out:
        return f"the conditions kept out of every fit ({', '.join(held_out)})"
    return "each condition, kept out of the fit in turn,"
