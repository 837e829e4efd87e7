"""Figures are drawn from files only, and the same files give the same bytes."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation.results import Budget, Curve, RowBudget
from coronaryuq.figures.draw import FIGURES, draw
from support.estimates import estimator, row


@pytest.fixture
def files(tmp_path):
    """Input files of the figures that need no rendering, with plausible numbers."""
    random = np.random.default_rng(1)
    fit = pd.DataFrame(
        {
            "target": ["PaoMin", "EFLV"], "description": ["Minimum aortic pressure", "Ejection fraction"],
            "unit": ["mmHg", "1"], "measured": [69.0, 0.67], "simulated": [68.0, 0.66], "tuned": True,
            "clinical": [True, False],
        }
    )  # fmt: skip
    write_csv(tmp_path / "fit.csv", fit)
    pairs = [
        pd.DataFrame({"row": f"osi_flow_{b}", "label": f"max OSI, mean flow, {b}", "y": random.random(9),
                      "q": random.random(9), "q_resampled": random.random(9)})
        for b in ("LAD", "RCA")
    ]  # fmt: skip
    write_csv(tmp_path / "pairs.csv", pd.concat(pairs))
    estimators = {"MC": estimator(), "crossfit-GP": estimator()}
    rows = [
        row(row=f"{kind}_{b.lower()}", label=f"{label}, {b}", estimators=estimators)
        for kind, label in (("osi_flow", "max OSI, mean flow"), ("tawss_flow", "min TAWSS, mean flow"),
                            ("ffr_ffr", "FFR, FFR"), ("ffr_flow", "FFR, mean flow"))
        for b in ("LAD", "RCA")
    ]  # fmt: skip
    write_json(tmp_path / "estimates.json", {"rows": plain(rows), "settings": {}})
    study = [
        {"row": "osi_flow_lad", "label": "max OSI, mean flow, LAD", "n_3d": n, "mean_mc": [0.1, 0.2],
         "rho_original": [0.3, 0.4], "rho_crossfit_gp_held_out": [0.8]}
        for n in (20, 40)
    ]  # fmt: skip
    write_json(tmp_path / "convergence.json", {"convergence": study})
    curve = Curve(0.5, 1e-4, [1e-3, 1e-4], [0.0, 5.0])
    curves = {"MC": curve, "MFMC-AE in-sample": curve}
    budget = RowBudget("osi_flow_lad", "max OSI, mean flow, LAD", 1e-5, 64, 2064, [1, 10], [1, 0.1], curves)
    write_json(tmp_path / "budget.json", plain(Budget([budget], [])))
    cells = [
        {"problem": "smooth", "method": method, "quantity": quantity, "n_3d": n, "trials": 400,
         "claimed_over_empirical": 1.02, "coverage_95": 0.94, "coverage_95_low": 0.91, "coverage_95_high": 0.96}
        for n in (25, 50)
        for method, quantity in (("MC", "mean"), ("crossfit-GP", "mean"), ("crossfit-GP", "quantile 0.5"))
    ]  # fmt: skip
    write_csv(tmp_path / "cells.csv", pd.DataFrame(cells))
    shares = [{"tested": "correct location", "on": network, "fraction": 0.9, "low": 0.6, "high": 0.97,
               "target_from": 0.9, "target_to": 1.0} for network in ("open loop", "loop")]  # fmt: skip
    write_csv(tmp_path / "shares.csv", pd.DataFrame(shares))
    answers = [{"network": "open loop", "hidden": "none", "named": named, "cases": 3} for named in ("none", "outside")]
    write_csv(tmp_path / "answers.csv", pd.DataFrame(answers))
    outcomes = [
        {"group": group, "method": method, "cases": 9, "share": 1.0, "low": 0.7, "high": 1.0}
        for group in ("nothing", "nothing, priors violated")
        for method in ("this search", "another")
    ]
    write_csv(tmp_path / "outcomes.csv", pd.DataFrame(outcomes))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "inputs"),
    [
        ("cardiac_function", {"fit": "fit.csv"}),
        ("osi_scatter", {"pairs": "pairs.csv"}),
        ("scatter", {"pairs": "pairs.csv"}),
        ("intervals_wss", {"estimates": "estimates.json"}),
        ("intervals_extremes", {"estimates": "estimates.json"}),
        ("intervals_ffr", {"estimates": "estimates.json"}),
        ("convergence", {"convergence": "convergence.json"}),
        ("budget", {"budget": "budget.json"}),
        ("osi_budget", {"budget": "budget.json"}),
        ("coverage", {"table": "cells.csv"}),
        ("hidden_effects", {"shares": "shares.csv", "answers": "answers.csv"}),
        ("rivals", {"outcomes": "outcomes.csv"}),
    ],
)
@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_same_files_give_the_same_bytes(files, name, inputs, suffix):
    paths = {key: str(files / value) for key, value in inputs.items()}
    drawn = []
    for k in range(2):
        draw(name, paths, str(files / f"{k}.{suffix}"))
        drawn.append((files / f"{k}.{suffix}").read_bytes())
    assert drawn[0] == drawn[1] and len(drawn[0]) > 4000


def test_every_named_figure_has_a_function():
    for module, _, function in (path.partition(":") for path in FIGURES.values()):
        assert callable(getattr(importlib.import_module(module), function))


def test_an_unknown_figure_is_reported_with_those_that_exist():
    with pytest.raises(InputError, match="unknown figure; available: cardiac_function"):
        draw("pie", {}, "pie.png")


@pytest.mark.parametrize("backend", ["nonsense", "module://matplotlib_inline.backend_inline"])
def test_neither_a_backend_from_outside_nor_a_home_without_files_matters(tmp_path, backend):
    (tmp_path / "home").write_text("")
    outside = {"MPLBACKEND": backend, "MPLCONFIGDIR": str(tmp_path / "home")}
    command = [sys.executable, "-c", "from coronaryuq.figures.style import plt; plt.figure()"]
    done = subprocess.run(command, env=os.environ | outside, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
