"""The search for hyper-parameters is judged on held-out runs and never worse there than the defaults."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.estimation.analysis.tuning import tune
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(steps=(40, 30), curve_nodes=9, restarts=1, folds=2, optuna_trials=3)


@pytest.mark.slow
def test_it_starts_from_the_settings_and_says_what_it_found(folder):
    found = tune(folder, folder / "rows.csv", SETTINGS, 3, folder / "tuning.json")
    assert found["loss"] <= found["default_loss"] == found["trials"][0]["loss"] and len(found["trials"]) == 3
    assert all(0 <= trial["loss"] <= 1 for trial in found["trials"])
    assert read_json(folder / "tuning.json") == found | {
        "best": found["best"] | {"steps": list(found["best"]["steps"])}
    }
    assert sum(found["best"]["steps"]) == 70
    Settings(**found["best"])


def test_a_row_that_is_not_there_is_reported(folder):
    with pytest.raises(InputError, match="no such row"):
        tune(folder, folder / "rows.csv", SETTINGS.model_copy(update={"rows": ["9"]}), 3, folder / "tuning.json")
