"""Captions of the figures: what to see, what is good, what is bad, and what to do then."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Caption:
    """Caption of a figure. good, bad: how it looks when all is well or not; then: what to do about the latter."""

    title: str
    see: str
    good: str = ""
    bad: str = ""
    then: str = ""


CAPTIONS = {
    "tree_ffr": Caption(
        "FFR along the tree",
        "Mean pressure over mean aortic pressure by the 0D model, median over the posterior. The dark edge is 0.80.",
        "The edge lies beyond every vessel that matters.",
        "Darker colours upstream of large branches.",
        "Read the probabilities in the summary: the edge shows a median only.",
    ),
    "lumen": Caption(
        "Flow through the lesions",
        "Mean speed and pressure over a cycle of the first 3D sample, the lumen straightened along its artery (scale "
        "across doubled); blood flows from left to right; the colours of a column are shared. Triangle: throat; bar: "
        "from the start to the end of the lesion; dashed: where FFR is read.",
        "A smooth jet that widens within some diameters.",
        "Speckles, or a jet one element wide.",
        "Refine the mesh (`mesh.jet_resolution`).",
    ),
    "walls": Caption(
        "Wall shear",
        "Time-averaged wall shear stress (TAWSS) and oscillatory shear index (OSI) of the first 3D sample, on common "
        "scales.",
        "High TAWSS in the throat, low TAWSS with high OSI only behind it.",
        "Patches as small as single elements.",
        "Compare averages over patches, not extremes.",
    ),
    "territories": Caption(
        "Perfusion map and territories",
        "Myocardial blood flow, and the territory assigned to each outlet. A case without a perfusion map shows the "
        "outlets whose flows were measured instead.",
        "Territories follow the arteries over the wall.",
        "A territory far from its artery, or a region of low flow cut by a border.",
        "Check registration of tree and perfusion map, then the outlets' names.",
    ),
    "cardiac_function": Caption(
        "Tuned circulation",
        "Difference of the tuned model from each target, at rest unless the target's name says otherwise; numbers: "
        "target → model. The band is ± 5 %.",
        "Measured targets inside the band.",
        "A measured target outside it.",
        "Check the value and its unit in the case, then allow more rounds (`calibration.rounds`).",
    ),
    "flows": Caption(
        "Outlet flows in hyperaemia",
        "Simulated flow of each outlet over the posterior (thick 50 %, thin 95 %) on the target with 95 % of its noise "
        "(grey).",
        "Coloured ranges within the grey ones, centred near the tick.",
        "A median outside the grey range.",
        "Look for a missing effect, or a wrong territory.",
    ),
    "marginals": Caption(
        "Posterior against prior",
        "Resistance of each outlet over its tuned value r̂: posterior (thick 50 %, thin 95 %) on the prior (grey).",
        "Ranges narrower than the prior: the data say something about the outlet.",
        "A range that ends where the prior ends.",
        "Check the target of that outlet, or widen the prior (`posterior.prior`; with `uncertainty: full`, "
        "`errors.microvascular` in the case).",
    ),
    "flow_correlation": Caption(
        "Correlation of the outlet flows",
        "Below the diagonal: simulated flows over the posterior; above: noise of the targets.",
        "Both halves alike where data dominate; negative values between neighbours where their sum is known best.",
        "Strong correlation below that is absent above.",
        "Two outlets are exchangeable for the data: judge their sum, not each.",
    ),
    "chains": Caption(
        "Chains: ranks",
        "Distribution of each chain's ranks among all draws, less that of a perfect chain; one line per chain and "
        "outlet. Grey: where 95 % of perfect chains stay entirely, without correlation between draws.",
        "Lines that stay in or near the grey band.",
        "A line that leaves it widely, on one side.",
        "Run longer chains (`posterior.dream.generations`).",
    ),
    "intervals_ffr": Caption(
        "FFR by estimator",
        "Mean of FFR by every estimator that the runs allow: thick calibrated 95 %, thin Chebyshev 95 %. Dashed: 0.80.",
        "Intervals overlap.",
        "Two estimators that exclude each other, or an exclamation mark: a number in brackets in the table.",
        "Read the warning; more 3D runs settle most of them.",
    ),
    "intervals_wss": Caption(
        "Wall shear by estimator",
        "As the figure of FFR, for averages over a part of the wall.",
        "Intervals overlap.",
        "Two estimators that exclude each other, or an exclamation mark.",
        "Read the warning; more 3D runs settle most of them.",
    ),
    "intervals_extremes": Caption(
        "Extremes of wall shear by estimator",
        "As the figure of FFR, for the paper's extremes at single points of the wall, which have settled on no mesh "
        "tried.",
        "Intervals overlap.",
        "Extremes far from the averages of the figure before.",
        "Use averages for any decision.",
    ),
    "scatter": Caption(
        "3D against 0D FFR",
        "Each dot is a 3D run: FFR by 3D against 0D at the same input, and at the input paired with it in the shared "
        "space (networks not trained on the run). Dashed: 0.80.",
        "Dots along a line (ρ near 1): the cheap model carries the expensive one.",
        "A cloud, or single dots far off.",
        "Check that run's convergence; learn losses from 3D (`losses.runs_3d`).",
    ),
    "convergence": Caption(
        "Convergence with 3D runs",
        "Correlation of the control variates, and Monte Carlo mean of FFR, from random subsamples, a dot each. The "
        "means are plain averages of runs, without the corrections that the table includes. Dashed: 0.80.",
        "Scatter that shrinks, means that do not drift.",
        "Means that drift with the number of runs.",
        "Add 3D runs (`samples.n_3d`).",
    ),
    "budget": Caption(
        "Variance against budget",
        "Above: variance of the mean of FFR that a budget would reach, in the cost of 3D runs; below: the cost of a "
        "smaller variance than now, which falls to the right.",
        "The curve of the recommended estimator lies lowest, or close to the lowest.",
        "All curves flat: the propagation sample or the chains limit the error.",
        "Make these longer before adding 3D runs.",
    ),
}  # fmt: skip
"""By the figure's name, in the order of the page."""
PAIRS_TABLES = {"pairs": "pairs", "pairs_gap": "pairs", "pairs_effects": "effects"}
"""Figure of a table model → table from which it is drawn; of other searches they have one name."""
SEARCHES = {
    "tree": Caption(
        "Misfit along the tree",
        "The arterial tree from left to right, coloured by the largest misfit after recalibration. Diamonds: "
        "named effects, on the vessel or at the bed where they act.",
        "All vessels pale yellow: up to about 3, the black line of the colour bar, is chance.",
        "A vessel much darker than the others: orange to dark red.",
        "See which effect is named: it may act elsewhere. Without one, check that instrument and its noise.",
    ),
    "residuals": Caption(
        "Measured and predicted",
        "Measurements with their noise, the recalibrated model, and the model with the named (or most probable) "
        "effects: the waveforms with the largest misfit or, without waveforms, predicted against measured.",
        "The model with the effects passes through the error bars, held-out panels included.",
        "It misses them as the recalibrated model does. (Under a held-out condition both may be off by one factor, "
        "because the state of its beds is not fitted.)",
        "Do not rely on the effect; check the noise and the conditions of these measurements.",
    ),
    "ranking": Caption(
        "Candidates",
        "Probabilities of the answers: a name, by the candidates of each round of the search; something else; nothing.",
        "One bar near 1.",
        "Several bars of a similar length.",
        "Take the measurement that distinguishes them, if the table names one.",
    ),
    "sizes": Caption(
        "Sizes of the effects",
        "Posterior and prior of the sizes of the named (or most probable) effects.",
        "A posterior much narrower than its prior.",
        "One as wide as its prior, or at the prior's end.",
        "Read the effect as possible, its size as unknown; measure under one more condition.",
    ),
    "pullback": Caption(
        "Pullback",
        "Pullback of a pressure wire: readings with noise and usual drift, the recalibrated model, and the model "
        "with the named (or most probable) effects, as the wire would read it. Shaded: where these act. Vessels end "
        "between two readings.",
        "Readings scatter around the model with the effects.",
        "A step that no line follows.",
        "Look for a lesion or a branch at that distance.",
    ),
    "source": Caption(
        "Unknown source of flow",
        "Flow that would have to leave at the end of the vessel for the model to agree with the measurements, with "
        "90 % intervals, where the search names nothing; negative where it would have to enter.",
        "The same waveform, in proportion to pressure or its rate of change, in every condition.",
        "A waveform of its own in every condition.",
        "Ask what takes blood there at that time of the beat: a branch, a collateral, a compliance.",
    ),
    "gap": Caption(
        "Misfit on held-out data",
        "Misfit on held-out measurements, with 90 % intervals: residuals divided by the standard deviation "
        "expected from noise and from the uncertainty of the fit.",
        "With the named effects about 1, as with the flexible discrepancy; or below, where the model is nearer to the "
        "data than is allowed for errors of its vessels, beds and time steps.",
        "Well above 1, or its interval above that of the flexible one.",
        "Something is missing that the library does not have: see the residuals.",
    ),
    "pairs": Caption(
        "Pressure drop and FFR",
        "Pressure drop against flow, and FFR of held-out samples, by branch.",
        "Repaired dots on the line of equal FFR.",
        "They leave it where the unchanged model does.",
        "See the error below; the law does not have this shape.",
    ),
    "pairs_gap": Caption(
        "Error of FFR on held-out samples",
        "Error of FFR on held-out samples, with 90 % intervals over samples.",
        "With the named effects as low as the Gaussian process.",
        "Clearly higher than the Gaussian process.",
        "The named laws lack a part of the difference between the models.",
    ),
    "pairs_effects": Caption(
        "Effects by branch",
        "Probability that each effect is part of the pressure-loss law of a branch.",
        "Bars near 0 or 1.",
        "Bars around 0.5.",
        "More pairs, or pairs over a wider range of flow, distinguish them.",
    ),
}
"""Of the searches for missing effects, by the figure's name, in the order of the page."""
INVENTED = "hidden"
"""The case whose measurements are invented, to test the search."""
SECTIONS = {
    "pictures": ("tree_ffr", "lumen", "walls", "territories"),
    "fit": ("cardiac_function", "flows"),
    "chains": ("marginals", "chains", "flow_correlation"),
    "estimates": ("intervals_ffr", "intervals_wss", "intervals_extremes", "scatter", "budget", "convergence"),
}
"""Figures of each section of the page."""
TITLES = {"pictures": "Flow", "fit": "Fit to the data", "chains": "Posterior", "estimates": "Estimates"}
"""Of the sections."""


def category_of(figure: str) -> str:
    """Return the title of the section of a figure, for Snakemake's own report."""
    return next((TITLES[section] for section, names in SECTIONS.items() if figure in names), "Others")


def category_of_search(invented: bool) -> str:
    """Return the heading of searches, which must not present an invented effect as one of the patient."""
    return "Self-test of the search" if invented else "Missing effects"


def labels_of(figure: str, captions: Mapping[str, Caption] = CAPTIONS) -> dict[str, str]:
    """Return what Snakemake's own report says of a figure."""
    caption = captions.get(figure)
    return {"figure": caption.title, "what to see": caption.see} if caption else {"figure": figure, "what to see": ""}
