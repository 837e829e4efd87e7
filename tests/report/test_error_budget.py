"""The error budget of an estimate on the page."""

from dataclasses import replace

from coronaryuq.report.error_budget import error_budget, includes
from support.estimates import estimator


def test_parts_of_the_bar_add_up_and_unmeasured_sources_are_named():
    found = error_budget(replace(estimator(), std=0.05, variance={"runs_3d": 1e-3, "propagation": 5e-4, "chain": 1e-3}))
    assert sum(float(part["percent"]) for part in found["parts"]) == 100
    assert found["words"] == (
        "3D runs 40 %, 0D propagation 20 %, posterior chains 40 %; not measured: mesh, time step and cycles"
    )
    assert found["left_out"] == "Not measured, so in none of these numbers: mesh, time step and cycles."


def test_measured_numerical_errors_are_included():
    variance = dict.fromkeys(("runs_3d", "propagation", "chain", "mesh", "time_step", "cycles"), 1e-4)
    measured = replace(estimator(), variance=variance)
    assert not error_budget(measured)["left_out"]
    text = includes([measured])
    assert text == (
        "The numerical error includes those of 3D runs, 0D propagation, posterior chains, mesh, time step and cycles."
    )
