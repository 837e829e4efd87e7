"""The source to improve first follows from shares of the variance and their intervals."""

from coronaryuq.report.improve import improve_first, numerical_share
from support.estimates import estimator, value


def test_the_source_to_improve_first_is_named_with_those_that_may_be_as_large():
    effects = {"flow": value(0.3, 0.2, 0.4), "lumen": value(0.6, 0.5, 0.7), "model": value(0.1, 0.05, 0.15)}
    assert improve_first(effects, None) == (
        "Improve first: the lumen's segmentation (shares of FFR's variance: lumen 60 %, flow 30 %, model 10 %; "
        "numerics not measured)."
    )
    close = effects | {"flow": value(0.45, 0.35, 0.55), "lumen": value(0.45, 0.35, 0.55)}
    assert improve_first(close, 0.0).startswith("Improve first: perfusion or the lumen's segmentation (")
    assert improve_first(effects, 0.5).startswith("Improve first: mesh and time step (")
    assert improve_first({}, None) == ""


def test_a_numerical_error_that_nobody_measured_has_no_share():
    assert numerical_share(estimator(), 0.04) is None
    assert numerical_share(estimator(variance={"runs_3d": 1e-3, "mesh": 0.01}), 0.03) == 0.25
