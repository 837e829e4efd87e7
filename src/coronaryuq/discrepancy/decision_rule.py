"""The decision rule: thresholds and prior probabilities by which the search for a missing effect tests and names.

Values were set by looking at the benchmark's cases and at two animals' recordings; their table is in
docs/explanation/discrepancy-method.md. Priors of the errors of model, vessels and noise are defined in
`inference.flexible`, `inference.vessel_errors` and `inference.noise`, numerical constants where they are used.
"""

from dataclasses import dataclass, field, fields
from typing import Any


def _threshold(value: Any, unit: str, description: str) -> Any:
    return field(default=value, metadata={"unit": unit, "description": description})


@dataclass(frozen=True)
class DecisionRule:
    """Thresholds of the search, each with unit and reason; see `table`."""

    prior_none: float = _threshold(0.4, "1", "Prior probability that nothing is missing.")
    prior_named: float = _threshold(
        0.4, "1", "Prior probability that an effect of the library is missing, shared equally by effects, then places."
    )
    prior_outside: float = _threshold(0.2, "1", "Prior probability that something outside the library is missing.")
    shortlist_score: float = _threshold(
        2.0, "sd", "Score-test statistic above which a candidate is shortlisted, run at larger sizes or reconsidered."
    )
    shortlist_effect_score: float = _threshold(
        3.0, "sd", "Score-test statistic above which the best place of an effect is shortlisted whatever its rank."
    )
    full_fits: int = _threshold(5, "candidates", "Maximum number of shortlisted candidates that are fitted in full.")
    contender_gap: float = _threshold(
        15.0, "nats", "A candidate whose log weight is within this distance of the best is fitted in full."
    )
    contender_share: float = _threshold(
        0.2, "1", "Fraction of the best one's gain added to it: frozen sensitivities err more after long moves."
    )
    diverged_gap: float = _threshold(
        10.0, "nats", "A fit has diverged if its log evidence is this far below that of the model without the effect."
    )
    diverged_refits: int = _threshold(
        5, "effects", "Maximum number of diverged effects refitted from other starts; each takes three full fits."
    )
    reconsidered: int = _threshold(40, "candidates", "Maximum number of candidates screened again at a better fit.")
    second_looks: int = _threshold(3, "times", "Maximum number of such screenings per round.")
    second_look_gain: float = _threshold(
        0.5, "nats", "A candidate is fitted again if a new estimate exceeds its fit by more than this."
    )
    rivals: int = _threshold(
        5, "candidates", "Maximum number of rivals fitted in full in a backward step or after re-screening."
    )
    likeliest_effects: int = _threshold(
        3, "effects", "Effects fitted where no test alarms or no candidate is worth naming, or shortlisted by score."
    )
    class_odds: float = _threshold(
        3.0, "nats", "Log odds, or log Bayes factor, below which data cannot distinguish two candidates: 20 to 1."
    )
    class_margin: float = _threshold(
        2.0, "nats", "Margin added to it for estimates that are not full fits, to decide which candidates to fit."
    )
    time_step_refit: float = _threshold(
        3.0, "noise sd", "Size of the time-step correction above which a round's candidates are compared again with it."
    )
    time_step_error: float = _threshold(
        0.5, "noise sd", "Time-step error beyond its allowance that is corrected: no size moves by more posterior sd."
    )
    visible_response: float = _threshold(
        0.3, "noise sd", "Whitened response at `visible_size` below which data cannot show an effect."
    )
    visible_size: float = _threshold(2.0, "prior sd", "Size at which the response has to exceed that.")
    detectable_signal: float = _threshold(
        6.0, "noise sd", "Detectable signal at its typical size from which the data are said to show an effect."
    )
    larger_sizes: int = _threshold(
        40, "candidates", "Maximum number run at larger sizes, of visible ones and of others, and at their estimates."
    )
    rerun: int = _threshold(150, "candidates", "Maximum number of candidates with a known response that are run again.")
    rerun_per_effect: int = _threshold(
        5, "candidates", "Number of candidates of every effect that are always run again."
    )
    distorted: float = _threshold(
        3.0, "prior sd", "Move of a nuisance parameter above which recalibration has left its prior."
    )
    far_behind: float = _threshold(
        40.0, "nats", "A candidate is dropped if, after two iterations, its log evidence is this far below the best."
    )
    further_searches: int = _threshold(
        2, "times", "Maximum number of continuations of a search after effects were not confirmed."
    )
    implausible: float = _threshold(
        4.0, "prior sd", "Size beyond which an effect is not named; its probability is that of something else."
    )
    prior_bound: float = _threshold(
        2.5758293035489004, "prior sd", "Bound of the central 99 % of a prior, beyond which a size is reported."
    )
    informed_size: float = _threshold(
        0.5**0.5, "prior sd", "Posterior sd below which a condition's data determine a size: half the variance remains."
    )
    informed_nuisance: float = _threshold(
        0.01, "1", "Fraction by which data must reduce a nuisance parameter's prior variance for it to be tested."
    )
    outlier: float = _threshold(
        0.001, "1", "Chance of an outlier in normal noise: a sample 4.8 sd off its neighbours' line among 700 samples."
    )
    same_time: float = _threshold(1.5, "samples", "Distance within which outliers of several series are simultaneous.")
    coincidence: float = _threshold(
        0.05, "1", "Chance of as many simultaneous outliers, over their number, below which the model is at fault."
    )


RULE = DecisionRule()
"""The thresholds in use."""


def table(rule: DecisionRule = RULE) -> str:
    """Return the thresholds as a Markdown table, for docs/explanation/discrepancy-method.md.

    Parameters
    ----------
    rule
        Thresholds; those in use by default.

    Returns
    -------
    str
        One row per threshold: name, value, unit, meaning.
    """
    rows = ["| threshold | value | unit | meaning |", "| --- | --- | --- | --- |"]
    for entry in fields(rule):
        value = f"{getattr(rule, entry.name):.4g}"
        rows.append(f"| `{entry.name}` | {value} | {entry.metadata['unit']} | {entry.metadata['description']} |")
    return "\n".join(rows)
