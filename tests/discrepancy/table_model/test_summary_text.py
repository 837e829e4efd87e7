"""The sentences on a branch agree with its result."""

from coronaryuq.discrepancy.table_model.summary_text import branch_text


def text_of(left, also=None, shift=0.3):
    """Sentences on a branch with a named loss and given held-out errors."""
    interval = {"size": 0.2, "size_low": 0.1, "size_high": 0.3}
    return branch_text(
        {
            "branch": "lad",
            "place": "a:b",
            "alarm": True,
            "outside_library": False,
            "overstated": False,
            "recalibration": {"own": 1.1},
            "own_loss_shift": shift,
            "rank_correlation": 1.0,
            "effects": ["quadratic_stenosis"],
            "classes": {"quadratic_stenosis": {"quadratic_stenosis": 1.0}},
            "probability": 1.0,
            "share_of_folds_with_this_name": 1.0,
            "sizes": {"quadratic_stenosis": {"of": "the mean root pressure", **interval}},
            "terms": [{"term": "quadratic", "unit": "mmHg s2/mL2", **interval}],
            "drop": {"measured": 20.0, "simulated": 3.0},
            "ffr_rmse": {"before": 0.19, "flexible": 0.02, **left},
            "doubt": False,
            "possibly_also": list(also or {}),
            "inclusion": also or {},
        }
    )


def test_a_law_that_predicts_no_better_than_recalibration_is_in_doubt():
    """As with a loss explained by scaling the model's own, or with exchanged branches."""
    answer = text_of({"after": 0.0289, "recalibration_alone": 0.0281})
    assert "In doubt: recalibration alone" in answer and "may also be present" not in answer
    assert "In doubt: recalibration alone" in text_of({"after": 0.0279, "recalibration_alone": 0.0281})
    assert "In doubt" not in text_of({"after": 0.0020, "recalibration_alone": 0.0281})


def test_sensor_errors_that_may_also_be_present_are_listed():
    answer = text_of({"after": 0.0020, "recalibration_alone": 0.0281}, {"pressure_gain": 0.84, "pressure_offset": 0.16})
    assert "Pressure gain (probability 0.84) or pressure offset (probability 0.16) may also be present" in answer


def test_a_large_scaling_of_the_models_own_loss_is_reported():
    left = {"after": 0.0020, "recalibration_alone": 0.0281}
    assert "multiplies the model's own loss by 1.1 (+2.4 standard" in text_of(left, shift=2.4)
    assert "the model's own loss" not in text_of(left, shift=1.0)
