"""Columns of the tables of a campaign: meaning and unit. "1": no unit; "text": a name or sentence; "yes/no"."""

Columns = tuple[tuple[str, str, str], ...]
"""Regular expression of a column's name, meaning, unit; the first that matches the whole name counts."""

SAMPLE: Columns = (("sample", "name of the sample", "text"),)
THETA: Columns = (
    *SAMPLE,
    ("chain", "chain of the posterior that the sample is a state of", "1"),
    ("draw", "generation of that chain", "1"),
    ("R_cor_scaling", "s: factor on the resistances of all coronary beds", "1"),
    ("BC_.+", "factor on the resistances r-hat of the bed", "1"),
    (".+", "uncertain parameter of the network, or factor on the resistances r-hat of the bed", "see network.json"),
)
OUTPUTS: Columns = (
    *SAMPLE,
    ("(mean|min|max)_flow:.+", "flow at the 0D location: mean, minimum or maximum over a cycle", "mL/s"),
    ("(mean|min|max)_pressure:.+", "pressure at the 0D location: mean, minimum or maximum over a cycle", "dyn/cm2"),
    ("ffr_.+", "fractional flow reserve distal to the stenosis: distal over aortic mean pressure", "1"),
    ("lowest_ffr_.+", "lowest fractional flow reserve of the artery, over its ends and its stenoses", "1"),
    ("pressure_drop_.+", "mean pressure before the stenosis less that where its FFR is read", "mmHg"),
    ("tawss_patch_min_.+", "smallest average of time-averaged wall shear stress over a patch of 1 mm", "dyn/cm2"),
    ("osi_patch_max_.+", "largest average of the oscillatory shear index over a patch of 1 mm", "1"),
    ("low_shear_area_.+", "share of the stenosis' wall with low time-averaged wall shear stress", "1"),
    ("tawss_.+", "time-averaged wall shear stress at the stenosis: minimum, mean or 1 % quantile by area", "dyn/cm2"),
    ("osi_.+", "oscillatory shear index at the stenosis: maximum, mean or 99 % quantile by area", "1"),
    ("distal_pressure_.+", "mean pressure distal to the stenosis", "dyn/cm2"),
    ("aortic_pressure", "mean pressure in the aorta", "dyn/cm2"),
)
RUN: Columns = (
    ("status", "ok or failed", "text"),
    ("reason", "why the run failed", "text"),
    ("cpu_s", "CPU time", "s"),
    ("cycles", "cardiac cycles until periodic", "1"),
    ("cycle_error", "relative change over the last cycle", "1"),
    ("refinement", "factor by which the time step was reduced", "1"),
)
PREDICTED: Columns = (*SAMPLE, ("status", "ok or failed", "text"), ("ffr_.+", "fractional flow reserve by 0D", "1"))
ROW: Columns = (
    ("row", "name of the estimated quantity", "text"),
    ("label", "3D quantity, 0D quantity, artery", "text"),
    ("column_3d", "3D quantity, a column of runs/outputs_3d.csv", "text"),
    ("column_0d", "0D quantity that predicts it, a column of runs/outputs_0d.csv", "text"),
)
OF_ROW = "unit of column_3d"
MEASUREMENTS: Columns = (
    ("condition", "condition of the measurement", "text"),
    ("quantity", "pressure, flow, volume, ...", "text"),
    ("location", "0D location", "text"),
    ("statistic", "mean, min, max or waveform", "text"),
    ("time", "time within the cycle, of waveforms", "s"),
    ("phase", "time within the cycle divided by its period, or part of the cycle", "1"),
    ("value", "measured value", "see column unit"),
    ("measured", "measured value", "CGS: mL/s, dyn/cm2, mL"),
    ("sd", "standard deviation of the measurement", "unit of the value"),
    ("unit", "unit of value and sd", "text"),
    ("recalibrated", "value of the recalibrated model", "CGS: mL/s, dyn/cm2, mL"),
    ("repaired", "value of the model with the named effects", "CGS: mL/s, dyn/cm2, mL"),
    ("fitted", "whether the value was fitted; otherwise it was held out", "yes/no"),
    ("named", "whether the search named an effect in this case", "yes/no"),
)
DETECTABLE: Columns = (
    ("effect", "effect of the library, or wiring error", "text"),
    ("place", "vessel, bed or sensor at which it acts", "text"),
    ("parameter", "first parameter of the effect", "text"),
    ("size", "typical size: median of the prior, or one standard deviation", "unit of the effect's parameter"),
    ("unit", "unit of the size", "text"),
    (
        "signal",
        "what recalibration leaves of it in the fitted data, to first order",
        "noise standard deviation",
    ),
)
EFFECT: Columns = (
    ("branch", "artery", "text"),
    ("effect", "effect that the model may be missing", "text"),
    ("place", "vessel, bed or sensor at which it acts", "text"),
    ("parameter", "parameter of the effect", "text"),
    ("probability", "posterior probability", "1"),
    ("round", "round of the forward step", "1"),
    ("score", "score test, in standard deviations", "1"),
    ("accepted", "whether the round added it", "yes/no"),
    ("unit", "unit of the size", "text"),
    ("size(_low|_high)?", "size of the effect, with its 90 % interval", "unit of the effect's parameter"),
    ("(posterior|prior)", "density of the size", "1 over the unit of the size"),
    ("named", "whether the search named it", "yes/no"),
)
GAP: Columns = (
    ("model", "compared model", "text"),
    ("misfit", "root mean square of the held-out residuals, in standard deviations", "1"),
    ("(low|high)", "90 % interval of the misfit", "1"),
    ("log_predictive_density", "mean log predictive density of the held-out values", "1"),
    ("expected_misfit", "misfit expected from noise alone", "1"),
)
PULLBACK: Columns = (
    *MEASUREMENTS,
    ("distance_mm", "distance along the path of the wire", "mm"),
    ("vessel", "vessel of the reading", "text"),
    ("acting", "effects of the best hypothesis that act there", "text"),
)
SOURCE: Columns = (
    ("condition", "condition", "text"),
    ("phase", "time as a share of the beat", "1"),
    ("(flow|low|high)", "flow that leaves at the end of the vessel, and its 90 % interval", "mL/s"),
    ("vessel", "the vessel", "text"),
)
PAIRS: Columns = (
    *SAMPLE,
    ("branch", "artery", "text"),
    ("flow", "measured mean flow through the stenosis", "mL/s in a campaign, otherwise unit of the given tables"),
    (
        "drop_.+",
        "mean pressure drop: measured, or of the model at the measured flow",
        "dyn/cm2 in a campaign, otherwise unit of the given tables",
    ),
    ("ffr_.+", "fractional flow reserve: measured, simulated, recalibrated, repaired, flexible", "1"),
)
PAIRS_PREDICTED: Columns = (
    ("branch", "artery", "text"),
    ("model", "simulated, recalibrated, repaired, measured", "text"),
    ("ffr_(low|median|high)", "5, 50 and 95 % quantile of FFR over the samples", "1"),
    ("at_most_.+", "fraction of the samples whose FFR is at most this", "1"),
)


OUTLETS: Columns = (
    ("name", "name of the outlet", "text"),
    ("vessel", "vessel that ends there", "text"),
    ("perfuses", "LV, RV or septum", "text"),
    ("branch", "LAD, LCx or RCA", "text"),
    ("label", "name for figures and tables", "text"),
)
TARGETS: Columns = (
    ("name", "name of the target", "text"),
    ("description", "the target in words", "text"),
    ("value", "measured value, or none", "unit of the target: docs/reference/case.md"),
)
PARAMETERS: Columns = (
    ("name", "name of the parameter", "text"),
    ("description", "the parameter in words", "text"),
    ("unit", "unit of the values", "text"),
    ("(value|initial|lower|upper)", "tuned value, start, bounds", "see column unit"),
    ("block", "block of parameters that are tuned together", "text"),
)
FIT: Columns = (
    ("target", "name of the target", "text"),
    ("description", "the target in words", "text"),
    ("unit", "unit of the values", "text"),
    ("(measured|simulated)", "value", "see column unit"),
    ("misfit", "difference over the target's standard deviation", "1"),
    ("relative", "difference over the measured value", "1"),
    ("(tuned|clinical)", "whether it was used in tuning; whether it was measured in this patient", "yes/no"),
)
LOSSES: Columns = (
    ("vessels", "0D vessels of the piece, from the first to the last", "text"),
    ("loss", "linear or quadratic in flow", "text"),
    ("unit", "unit of the next three columns", "text"),
    ("(own|added|added_sd)", "own loss; what is added to it, and its standard deviation", "see column unit"),
    ("(own|added|added_sd)_mmhg", "the same as a pressure at the mean flow", "mmHg"),
    ("meaning", "what a loss that differs from zero stands for; empty: not certain", "text"),
)
DRAWS: Columns = (
    ("(chain|generation)", "number of the chain, number of its generation", "1"),
    ("log_density", "log density of the posterior up to a constant", "1"),
    *THETA,
)
FRACTIONS: Columns = (
    ("(outlet|bc)", "outlet, and its 0D boundary condition", "text"),
    ("volume", "volume of its territory", "cm3"),
    (".+_flow", "mean flow: target, fitted", "mL/s"),
    ("(r_hat|.+_resistance)", "distal resistance Ra + Ram + Rv", "dyn s/cm5"),
    (".+", "fraction of the flow, multiplier of r-hat, standard deviation, or relative error of the fraction", "1"),
)
PRESSURES: Columns = (
    ("vessel", "vessel of the tree", "text"),
    ("position", "arc length along it over its length", "1"),
    ("pressure(_low|_high)?", "mean pressure: median, 5 and 95 % quantile over the posterior", "dyn/cm2"),
    ("ffr(_low|_high)?", "mean pressure over that of the aorta: median, 5 and 95 % quantile", "1"),
    ("flow(_low|_high)?", "mean flow: median, 5 and 95 % quantile", "mL/s"),
)
FOR_PHYSICIANS: Columns = (
    ("quantity", "lowest FFR of an artery, or pressure drop over a lesion", "text"),
    ("name", "artery or lesion", "text"),
    ("artery", "artery in which it is read", "text"),
    ("vessel", "vessel of the tree in which it is read", "text"),
    ("arc", "where along that vessel", "cm"),
    ("unit", "unit of the next three columns", "text"),
    ("(low|median|high)", "5 % quantile, median and 95 % quantile over the posterior, by 0D", "see column unit"),
)
ROWS: Columns = (
    *ROW,
    ("(qoi_3d|qoi_0d|branch)", "3D quantity, 0D quantity, artery, for the label", "text"),
    ("networks", "whether MFMC-AE is trained for the row", "yes/no"),
    ("shared", "whether control variates of other rows see its 0D output", "yes/no"),
    ("warning", "what a reader has to know about the quantity itself", "text"),
)
TABLE: Columns = (
    *ROW,
    ("(estimator|method)", "estimator, and its method", "text"),
    ("mean", "estimate of the mean", OF_ROW),
    ("std", "reported standard error of the estimate", OF_ROW),
    (
        "(chebyshev_95|chebyshev_99|calibrated)_(low|high)",
        "interval of the mean: Chebyshev 95 %, 99 %; calibrated 95 %",
        OF_ROW,
    ),
    ("rho_.+", "correlation of the 3D quantity with its predictor: plain 0D, in-sample, held-out", "1"),
    (
        "variance_.+",
        "variance of the estimate by source: 3D runs, propagation, chain, mesh, time step, cycles; empty: not measured",
        "square of that of column_3d",
    ),
    ("(n_3d|n_0d|predictions)", "3D runs, 0D runs, evaluations of the predictor", "1"),
    ("warnings", "reasons for caution", "text"),
)
OUTPUT_PAIRS: Columns = (
    *ROW,
    *SAMPLE,
    ("y", "3D output", "unit of the row's column_3d"),
    ("q.*", "0D output", "unit of the row's column_0d"),
)
PAPER_TABLE: Columns = (
    *ROW,
    ("(mean|std|calibrated)_.+", "estimate of the mean, its standard deviation, its interval", OF_ROW),
    ("paper_std_.+", "as printed in the paper", OF_ROW),
    ("(paper_)?rho_.+", "correlation with the predictor", "1"),
    (
        "(best_method|recommended|warnings)",
        "control variates chosen by crossfit-GP; recommended estimator; warnings",
        "text",
    ),
    ("(n_3d|predictions_best)", "3D runs; evaluations of the predictor", "1"),
    ("emulator_error", "held-out mean square error of the emulator over the variance", "1"),
)
COVERAGE: Columns = (
    ("(problem|method|quantity|row)", "problem, estimator, estimated quantity", "text"),
    ("cpu_s", "CPU time", "s"),
    ("empirical_std", "standard deviation of the estimates over the trials", "unit of the estimated quantity"),
    (".+", "number of runs or trials, fraction covered, or reported over empirical standard error", "1"),
)
DRIVE: Columns = (("t", "time", "s"), ("value", "pressure or flow", "pressure unit of the model; mL/s"))
LOCATED: Columns = (
    ("mean", "mean residual", "CGS: mL/s, dyn/cm2, mL"),
    ("score", "mean residual in standard deviations", "1"),
    ("(p|q)", "p-value; false discovery rate", "1"),
    *MEASUREMENTS,
)
TREE: Columns = (
    ("(vessel|parent|named)", "vessel, its parent, effects that act there", "text"),
    ("mean_flow", "mean flow", "mL/s"),
    ("disagreement", "largest score, in standard deviations", "1"),
)
LAWS: Columns = (
    ("(branch|effects|terms)", "artery, effects, terms of the law", "text"),
    ("log_evidence", "log evidence", "1"),
    ("rms_ffr", "root mean square error of FFR", "1"),
)
BENCHMARK: Columns = (
    (
        "(tested|on|network|effect|strength|noise|hidden|named)",
        "measure, network, hidden effect, its strength, the noise, the answer",
        "text",
    ),
    ("cpu_s", "CPU time of a search", "s"),
    (".+", "number of cases, or fraction of them with its 95 % interval", "1"),
)
