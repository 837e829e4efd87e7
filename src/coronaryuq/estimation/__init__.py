"""Multi-fidelity estimates of the quantities of interest, with intervals.

`estimates.json`: {rows, coarse, settings, provenance}; each row has
    row, label, column_3d, column_0d, variance_3d, n_propagation
    paper: rho_original, std_mc, std_mfmc with the paper's conventions
    estimators: MC, MFMC, MFMC-AE, best, and with a coarse 3D level BLUE, multilevel →
        method, mean, std, chebyshev_95, chebyshev_99, calibrated (each low, high,
        level), rho_held_out, rho_in_sample and std_in_sample where fitted, n_3d, n_0d (0D runs made), predictions
        (evaluations of the control variate), beta, residual_variance, propagation_variance, warnings
    recommended: the estimator with the least claimed std that carries no warning
    beyond_the_mean: variance, quantiles, probability_at_or_below (FFR), sobol_first_order → value, std, low, high,
        level
    emulator_error: held-out mean square error over variance of the 0D output's emulator
    integrated_exactly: name of the input with a known law that was integrated, or null
    levels: with a coarse 3D level, variance per sample of the parts {fine, coarse, cheap} of `multilevel`; else null
    warnings: those of the runs, each with the rule that was applied
coarse: with such a level {runs, failed, coarse_cpu_s, fine_cpu_s (per run), rows: {row: {without, claim_ratio, gain,
    best_runs_per_fine}}}, see `level_allocation.worth`; else null
`table.csv`: one line per row and estimator.
`convergence.json`: {convergence: [{row, label, n_3d, rho_original, mean_mc, rho_ae_in_sample, rho_ae_held_out,
    rho_best_held_out}]}, lists with one item per subsample.
`budget.json`: {budget: [{row, label, cost_ratio, n_3d, n_0d, budget_3d_runs, variance_factor, estimators: {name:
    {rho, variance_now, optimal_variance, additional_cost}}}], plan: [{row, wanted, now, more_3d, more_0d, cost,
    cost_of_half}]}.
"""
