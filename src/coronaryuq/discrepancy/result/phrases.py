"""Phrases of the summary of a search, each from the numbers that it states."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from coronaryuq.core.wording import interval_text, listed, p_text
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference.noise import TOO_LOUD

LEAST_INFORMATION = 0.35
"""Expected information (nats) below which a measurement hardly distinguishes a class: half of log 2, that of two."""
EXPECTED_MISFIT = "1 is expected from noise and fit uncertainty"
QUIET, UNLIKELY = 0.5, 1e-4
"""Scatter over the stated standard deviation, and its probability, below which the latter is reported as too large."""
WRONG_UNIT = 0.1
"""Size of the noise over the stated one below which the latter may be in another unit than the values."""
UNPREDICTED = 0.001
"""p-value of the held-out data below which the text says that they are not predicted."""
MOST_LISTED, MOST_MISSED = 4, 15
"""Maximum number of nuisance parameters or samples, and of effects that the data would not show, in one sentence."""


def noise_notes(noise: Mapping[str, Mapping]) -> str:
    """Report waveform noise of another size than stated, or correlated in time."""
    each = [
        f"{one['scale']:.2f} times the stated size{f', correlated over {time:.2g} s,' if time else ''} for {name}"
        for name, one in noise.items()
        for time in [one["correlation_time"]]
    ]
    quiet = [name for name, one in noise.items() if one["scale"] < WRONG_UNIT]
    loud = [name for name, one in noise.items() if one["scale"] > TOO_LOUD]
    text = f"By the scatter of the waveforms, their noise is {listed(each)}; the search uses this. " if each else ""
    text += f"Check that standard deviations of {listed(quiet)} are in the unit of the values. " if quiet else ""
    doubt = f"So much noise of {listed(loud)} may be an effect that the library lacks: check these waveforms. "
    return text + doubt * bool(loud)


def uneven_notes(uneven: Mapping[str, float]) -> str:
    """Report noise that is larger under some conditions than under others."""
    each = [f"{times:.2g} times as large, relative to its stated size, for {where}" for where, times in uneven.items()]
    return f"Noise is {listed(each)} as under other conditions. " * bool(each)


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
    left_out = f"{len(outliers)} samples are outliers and were left out: {listed(samples)}. "
    return f"{left_out}Check whether they are artefacts. "


def overstated_sd_warning(scatter: Mapping[str, Sequence[float]]) -> str:
    """Warn of standard deviations of a quantity so large that they would hide any effect; scatter: see `facts`."""
    times = {name: np.sqrt(squares / expected) for name, (squares, expected) in scatter.items()}
    quiet = [name for name, size in times.items() if size <= QUIET and stats.chi2.cdf(*scatter[name]) <= UNLIKELY]
    sizes = listed([f"of the {name} are only {times[name]:.2g} times" for name in quiet])
    return (
        f" The residuals {sizes} as large as the stated standard deviations, which would hide a missing effect: check "
        "that these are correct and in the unit of the values."
    ) * bool(quiet)


def detectable_text(detectable: Mapping) -> str:
    """State how many effects the data would show, with a typical size and at the place where they show most."""
    count, missed = len(detectable["effects"]), [name.replace("_", " ") for name in detectable["missed"]]
    but = f"; not: {', '.join(missed)}" * (0 < len(missed) <= MOST_MISSED)
    return (
        f"At their typical sizes, these data would show {count or 'none'} of the {detectable['of']} kinds of effect "
        "that this network can have (signals of at least "
        f"{detectable['signal']:.0f} noise standard deviations; see detectable.csv{but})."
    )


def prediction_warning(p: float, held_out: list[str]) -> str:
    """Warn that a model which agrees with the fitted data does not predict the held-out data, if so."""
    if p >= UNPREDICTED:
        return ""
    if not held_out:
        return f" However, what is left out of the fit is not predicted by the rest ({p_text(p)}): the data disagree."
    remedy = "check these conditions in the conditions file, or hold other conditions out so that these are searched"
    return f" However, the model does not predict the held-out data ({p_text(p)}): {remedy}."


def class_probability_text(members: Sequence[Mapping]) -> str:
    """State the probability of a named effect and of the effects that are indistinguishable from it."""
    accepted, *others = members
    if not others:
        return f"probability {accepted['probability']:.2f}"
    total = sum(member["probability"] for member in members)
    names = [f"{label_text(member)} {text}" for member in others if (text := f"{member['probability']:.2f}") != "0.00"]
    return (
        f"probability {total:.2f} for its class, {accepted['probability']:.2f} for this member; indistinguishable from "
        f"it with these data: {', '.join(names) or 'others, below 0.01 each'}"
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
        return "No mean pressure or flow of these vessels would distinguish them well. "
    best = informative[0]
    what = f"The mean {best['quantity']} at {best['location']} under {best['condition']}"
    what += ", measured with another instrument," if best["already_measured"] else ""
    information = f"{best['expected_information_nats']:.2g} nats"
    return f"{what} would distinguish them best (expected information {information}). "


def varying_text(best: Sequence[Mapping]) -> str:
    """State which of the best candidates would need a different size under each condition."""
    sizes = [(label_text(effect), sizes_by_condition(effect["varying"])) for effect in best if effect["varying"]]
    if len(best) == 1:
        ((label, text),) = sizes
        return f"the best candidate, {label}, would need a different size under each condition ({text})"
    which = listed([f"{label} ({text})" for label, text in sizes])
    labels = listed([label_text(effect) for effect in best])
    return f"the best candidates are {labels}, of which {which} would need a different size under each condition"


def size_text(sizes: Sequence[Mapping]) -> str:
    """State the sizes of an effect with 90 % intervals."""
    return ", ".join(
        f"{'read early by' if size['early'] else size['meaning'] + ':'} "
        + interval_text(size["value"], size["low"], size["high"])
        + " s" * size["early"]
        for size in sizes
    )


def sizes_by_condition(varying: Mapping) -> str:
    """State the first size of an effect under each condition that determines it, with 90 % intervals."""
    sizes = [f"{condition} {interval_text(*values)}" for condition, values in varying["conditions"].items()]
    return f"{varying['label']}: {', '.join(sizes)} {varying['unit']}".rstrip()


def misfit_change(before: float, after: float) -> str:
    """Describe the change of the held-out misfit to two decimals."""
    if f"{before:.2f}" == f"{after:.2f}":
        return f"stays at {after:.2f} ({EXPECTED_MISFIT})"
    return f"{'falls' if after < before else 'rises'} from {before:.2f} to {after:.2f} ({EXPECTED_MISFIT})"


def conflict_text(intro: str, conflicts: Sequence[Mapping]) -> str:
    """List the nuisance parameters far outside their priors, the farthest first."""
    far = sorted((one for one in conflicts if abs(one["moved"]) > RULE.distorted), key=lambda one: -abs(one["moved"]))
    texts = [f"the {one['name']} by {one['moved']:+.1f} (×{one['factor']:.2g})" for one in far[:MOST_LISTED]]
    if not texts:
        return ""
    texts[0] = texts[0].replace(" (×", " standard deviations of its prior (×")
    if len(far) > MOST_LISTED:
        texts.append(f"{len(far) - MOST_LISTED} more")
    return f"{intro} {listed(texts)}. "


def within_text(named: Mapping) -> str:
    """State where in its vessel a named effect acts; empty unless it has a start and an end."""
    start, end = (named.get("physical", {}).get(f"{one} in the vessel, mm") for one in ("start", "end"))
    return "" if start is None or end is None else f", {start:.0f} to {end:.0f} mm from its start"


def label_text(effect: Mapping) -> str:
    """Name an effect and its place."""
    place = effect["place"].replace("~", " and ")
    return f"{effect['effect'].replace('_', ' ')} {'at ' * (place != 'everywhere')}{place}"
