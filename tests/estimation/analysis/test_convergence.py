"""Convergence with the number of 3D runs, from files to a file."""

from coronaryuq.estimation import stage
from coronaryuq.estimation.results import read_convergence
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(
    autoencoder=False, convergence_subsamples=6, convergence_subsamples_fitted=2, convergence_sizes=[20, 400], min_3d=20
)


def test_convergence_skips_sizes_that_leave_too_few_runs_out(folder):
    stage.convergence(folder, SETTINGS, 3, folder / "convergence.json")
    (entry,) = read_convergence(folder / "convergence.json")
    assert entry.n_3d == 20 and len(entry.rho_original) == 6 and len(entry.rho_crossfit_gp_held_out) == 2
    assert min(entry.rho_crossfit_gp_held_out) > 0.9
