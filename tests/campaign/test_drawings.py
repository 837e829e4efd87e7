"""The figures of a campaign."""

from coronaryuq.campaign.drawings import figures, paper_figures
from coronaryuq.campaign.paths import Paths
from coronaryuq.config import Campaign
from coronaryuq.figures.draw import FIGURES

PATHS = Paths("x")


def test_every_figure_can_be_drawn():
    assert set(figures(Campaign(name="x"), PATHS)) | set(paper_figures(PATHS)) <= set(FIGURES)


def test_convergence_needs_runs_that_are_held_back():
    small = Campaign(name="x", samples={"n_3d": 24}, estimation={"convergence_sizes": [12]})
    assert "convergence" not in figures(small, PATHS)


def test_fields_are_drawn_if_the_ensemble_solver_keeps_them():
    assert "walls" in figures(Campaign(name="x"), PATHS)
    assert "walls" not in figures(Campaign(name="x", backend="svsolver"), PATHS)
    assert figures(Campaign(name="x"), PATHS)["scatter"] == {"pairs": "results/x/estimation/pairs.csv"}
