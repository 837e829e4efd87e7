"""Searches on tables of pairs: what noise must not change, what samples cannot tell apart, sizes with intervals."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.table_model.search import TOGETHER, _words, discover_pairs
from coronaryuq.discrepancy.table_model.tables import _zero_flow, branches, read_pairs

ZERO_FLOW = 5.0


def noisy_pairs(
    folder,
    seed,
    count=60,
    quadratic=0.0,
    linear=0.0,
    offset=0.0,
    gain=0.0,
    flow_gain=0.0,
    ffr=0.002,
    outlet=0.01,
    power=2,
):
    """Tables of one branch with its loss and sensors; errors of FFR, and relative ones of the outlet's readings."""
    random = np.random.default_rng(seed)
    root, own, beyond = 86.0 - 3.0 * random.random(count), 3.0, 2.0
    bed = 60.0 * random.uniform(0.5, 2.0, count) * random.uniform(0.7, 1.25, count)
    simulated = (root - ZERO_FLOW) / (own + beyond + bed)
    low, high = np.zeros(count), simulated.copy()
    for _ in range(60):
        flow = 0.5 * (low + high)
        left = root - ZERO_FLOW - (own + linear + beyond + bed) * flow - quadratic * flow**power
        low, high = np.where(left > 0.0, flow, low), np.where(left > 0.0, high, flow)
    distal = root - (own + linear) * flow - quadratic * flow**power
    end = distal - beyond * flow
    noise = random.normal(size=(3, count))
    read = {
        "sample": [f"s{i}" for i in range(count)],
        "mean_pressure:heart:aorta": root,
        "mean_pressure:v1:BC": end * (1.0 + outlet * noise[0]),
        "mean_flow:v1:BC": flow * (1.0 + flow_gain) * (1.0 + outlet * noise[1]),
        "ffr_x": (distal * (1.0 + gain) + offset) / root + ffr * noise[2],
    }
    own_distal = root - own * simulated
    made = {
        "sample": read["sample"],
        "mean_pressure:heart:aorta": root,
        "mean_pressure:v0:J": own_distal,
        "mean_flow:v0:J": simulated,
        "mean_pressure:v1:BC": own_distal - beyond * simulated,
        "mean_flow:v1:BC": simulated,
        "ffr_x": own_distal / root,
    }
    for name, table in (("0d.csv", made), ("3d.csv", read)):
        pd.DataFrame(table).to_csv(folder / name, index=False)
    return folder / "0d.csv", folder / "3d.csv"


def branch_of(files):
    return branches(*read_pairs(*files), *files)[0]


@pytest.mark.parametrize("hidden", [{}, {"gain": -0.04}, {"flow_gain": 0.15}, {"quadratic": 1.2}])
@pytest.mark.parametrize("outlet", [0.003, 0.01, 0.02])
def test_noise_makes_no_zero_flow_pressure(tmp_path, hidden, outlet):
    """Where flow hardly changes the pairs tell little of it, and it stays near none: within half a prior sd on average
    over trials (0.1 of the root's pressure), and two of it in each."""
    found = [branch_of(noisy_pairs(tmp_path, seed, outlet=outlet, **hidden)) for seed in range(20)]
    shares = [branch.venous / branch.root0.mean() for branch in found]
    assert np.mean(shares) < 0.05 and max(shares) < 0.2


def test_a_nearly_closed_artery_leaves_the_zero_flow_pressure_a_spread():
    """All pressures behind it are the least there is, near which no bed's factor may be taken beyond that."""
    read = {"p": np.full(50, 5.0), "q": 1e-4 * np.linspace(1.0, 2.0, 50), "root": np.full(50, 90.0)}
    made = {"p": np.linspace(70.0, 80.0, 50), "q": np.linspace(1.0, 2.0, 50), "root": np.full(50, 90.0)}
    root, bed = ("mean_pressure", "heart"), ("mean_pressure", "BC")
    pressures, flows = {root: ("root", "root"), bed: ("p", "p")}, {("mean_flow", "BC"): ("q", "q")}
    venous, spread = _zero_flow(pd.DataFrame(made), pd.DataFrame(read), pressures, flows, root)
    assert venous < 5.0 and np.isfinite(spread)


def test_outlets_that_only_one_table_has_are_told(tmp_path):
    files = noisy_pairs(tmp_path, 1)
    rewritten(files[1], lambda table: table.drop(columns=["mean_pressure:v1:BC"]))
    with pytest.raises(InputError, match="no outlet has both"):
        branch_of(files)


@pytest.mark.parametrize("outlet", [0.001, 0.01, 0.02])
def test_the_zero_flow_pressure_is_found_where_flow_changes(tmp_path, outlet):
    """On average over trials within three standard errors, which grow with the noise, and a bias of the prior's."""
    found = [branch_of(noisy_pairs(tmp_path, seed, quadratic=14.0, outlet=outlet)).venous for seed in range(40)]
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert np.std(found) < 100.0 * outlet + 0.5
    assert abs(np.mean(found) - ZERO_FLOW) < 3.0 * error + 0.5


def rewritten(file, change):
    table = pd.read_csv(file)
    change(table).to_csv(file, index=False)


def with_neighbour(table, apart):
    """Another pressure beside the distal one, so many times it, and with another flow."""
    flow = 0.5 * table["mean_flow:v0:J"]
    return table.assign(**{"mean_pressure:v9:J9": apart * table["mean_pressure:v0:J"], "mean_flow:v9:J9": flow})


@pytest.mark.parametrize("shown", ["%.6f", "%.4f", "%.3f", "%.2f", "%.6g", "%.4g", "%.3g"])
def test_a_rounded_table_has_its_distal_pressure(tmp_path, shown):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    exact = branch_of(files)
    rewritten(files[0], lambda t: with_neighbour(t, 0.97).map(lambda v: v if isinstance(v, str) else float(shown % v)))
    branch = branch_of(files)
    assert branch.place == "v0:J" and branch.flow0 == pytest.approx(exact.flow0, rel=0.06)
    assert branch.distal0 == pytest.approx(exact.distal0, rel=0.01)


@pytest.mark.parametrize(("decimals", "apart"), [(12, 1.0001), (4, 1.0005), (3, 1.005), (2, 1.02), (1, 1.02)])
def test_a_wrong_pressure_is_not_taken_for_rounding(tmp_path, decimals, apart):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    rewritten(files[0], lambda t: with_neighbour(t, apart).drop(columns="mean_pressure:v0:J").round(decimals))
    with pytest.raises(InputError, match="no mean_pressure column equals FFR times the root's pressure"):
        branch_of(files)


def test_two_pressures_that_rounding_makes_one(tmp_path):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    rewritten(files[0], lambda t: with_neighbour(t, 1.0002).assign(ffr_x=t["ffr_x"].round(2)))
    with pytest.raises(InputError, match=r"is mean_pressure:v.:J.? or mean_pressure:v.:J.?, as far as it is rounded"):
        branch_of(files)


def test_the_column_of_the_distal_pressure_is_said(tmp_path):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    answer = discover_pairs(*files, tmp_path / "out", 1)
    assert answer["held_out"]["branches"][0]["distal_pressure"] == "mean_pressure:v0:J"
    assert "the drop of pressure to v0:J is " in answer["paragraph"]


def test_a_law_that_recalibration_predicts_as_well_is_in_doubt():
    """As with a loss that stretching the model's own explains, or branches that have been exchanged."""
    answer = discovered({"after": 0.0289, "recalibration_alone": 0.0281})
    assert "In doubt: recalibration alone" in answer and "leave room" not in answer
    assert "In doubt: recalibration alone" in discovered({"after": 0.0279, "recalibration_alone": 0.0281})
    assert "In doubt" not in discovered({"after": 0.0020, "recalibration_alone": 0.0281})


def test_rows_that_are_not_the_same_samples_are_in_doubt(tmp_path):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    same = discover_pairs(*files, tmp_path / "same", 1)
    assert same["held_out"]["branches"][0]["goes_together"] > 0.9 and "one sample" not in same["paragraph"]
    table = pd.read_csv(files[1])
    values = table.columns != table.columns[0]
    order = np.random.default_rng(3).permutation(len(table))
    table.loc[:, values] = table.loc[order, values].to_numpy()
    table.to_csv(files[1], index=False)
    answer = discover_pairs(*files, tmp_path / "out", 1)
    assert answer["held_out"]["branches"][0]["goes_together"] < TOGETHER
    assert "see whether a row of both tables is one sample" in answer["paragraph"]


def test_sensors_that_may_be_off_beside_a_loss_are_said():
    answer = discovered(
        {"after": 0.0020, "recalibration_alone": 0.0281}, {"pressure_gain": 0.84, "pressure_offset": 0.16}
    )
    assert "these samples leave room for pressure gain (0.84) or pressure offset (0.16)" in answer


def test_what_recalibration_does_to_the_models_own_loss_is_said_where_it_is_much():
    left = {"after": 0.0020, "recalibration_alone": 0.0281}
    assert "multiplies the model's own loss by 1.1 (+2.4 standard" in discovered(left, moved=2.4)
    assert "the model's own loss" not in discovered(left, moved=1.0)


@pytest.mark.parametrize("share", [0.2, 0.35])
def test_a_model_with_a_loss_that_is_not_there_lacks_nothing(tmp_path, share):
    """Its own loss is 3: what is measured has a share of it."""
    answer = discover_pairs(*noisy_pairs(tmp_path, 5, linear=3.0 * (share - 1.0)), tmp_path / "out", 1)
    assert answer["outside_library"] and not answer["named"]
    assert "The model seems to have a loss that is not there, or too strong a one" in answer["paragraph"]


def test_a_drop_that_recalibration_takes_up_is_no_agreement(tmp_path):
    answer = discover_pairs(*noisy_pairs(tmp_path, 6, linear=1.0), tmp_path / "out", 1)
    assert not answer["named"] and not answer["alarm"]
    assert "which recalibration takes up: it multiplies the model's own loss by 1.3" in answer["paragraph"]


def test_a_loss_beyond_recalibration_is_one_that_is_missing(tmp_path):
    """Two and a half times the model's own, and in the same form."""
    answer = discover_pairs(*noisy_pairs(tmp_path, 7, linear=4.5), tmp_path / "out", 1)
    assert answer["alarm"] and not answer["outside_library"]


def test_a_stenosis_beside_an_offset_is_not_taken_for_too_much_loss(tmp_path):
    answer = discover_pairs(*noisy_pairs(tmp_path, 8, quadratic=1.5, offset=3.0), tmp_path / "out", 1)
    assert "quadratic_stenosis" in [one["effect"] for one in answer["named"]]
    assert not answer["held_out"]["branches"][0]["overstated"]


def discovered(left, beside=None, moved=0.3, together=1.0):
    """The sentences on a branch with a named loss, with these held-out errors."""
    interval = {"size": 0.2, "size_low": 0.1, "size_high": 0.3}
    return _words(
        {
            "branch": "lad",
            "place": "a:b",
            "alarm": True,
            "outside_library": False,
            "overstated": False,
            "recalibration": {"own": 1.1},
            "own_loss_moved": moved,
            "goes_together": together,
            "effects": ["quadratic_stenosis"],
            "classes": {"quadratic_stenosis": {"quadratic_stenosis": 1.0}},
            "probability": 1.0,
            "share_of_folds_with_this_name": 1.0,
            "sizes": {"quadratic_stenosis": {"of": "the root's mean pressure", **interval}},
            "terms": [{"term": "quadratic", "unit": "mmHg s2/mL2", **interval}],
            "drop": {"measured": 20.0, "simulated": 3.0},
            "ffr_rmse": {"before": 0.19, "flexible": 0.02, **left},
            "doubt": False,
            "possibly_also": list(beside or {}),
            "inclusion": beside or {},
        }
    )


def test_a_branch_that_only_one_table_has_is_noted(tmp_path, capsys):
    files = noisy_pairs(tmp_path, 1)
    rewritten(files[1], lambda table: table.assign(FFR_y=table["ffr_x"]))
    branch_of(files)
    assert f"note: {files[1]}: FFR_y: not in the other table" in capsys.readouterr().err


@pytest.mark.parametrize(("table", "value"), [(0, 0.0), (1, 0.0), (1, -0.01)])
def test_blood_that_does_not_flow_downstream(tmp_path, table, value):
    files = noisy_pairs(tmp_path, 1, quadratic=1.0)
    frame = pd.read_csv(files[table])
    frame.loc[7, "mean_flow:v1:BC"] = value
    frame.to_csv(files[table], index=False)
    with pytest.raises(InputError, match=r"mean_flow:v1:BC = .*: in sample s7; want a positive flow"):
        discover_pairs(*files, tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()


def test_an_empty_pressure_is_not_the_root_s(tmp_path):
    files = noisy_pairs(tmp_path, 1)
    for file in files:
        frame = pd.read_csv(file)
        frame.insert(1, "mean_pressure:away:away", np.nan if file == files[1] else 50.0)
        frame.to_csv(file, index=False)
    assert branch_of(files).root3.mean() == pytest.approx(84.5, abs=1.0)


def test_inputs_that_are_the_same_in_all_samples(tmp_path):
    """Runs of one parameter set leave the reference nothing to learn from but the mean."""
    files = noisy_pairs(tmp_path, 1)
    simulated = pd.read_csv(files[0])
    simulated.iloc[:, 1:] = simulated.iloc[0, 1:].to_numpy(float)
    simulated.to_csv(files[0], index=False)
    measured = pd.read_csv(files[1])
    discover_pairs(*files, tmp_path / "out", 1)
    flexible = pd.read_csv(tmp_path / "out" / "pairs.csv").ffr_flexible
    assert flexible.to_numpy() == pytest.approx(measured.ffr_x.mean(), abs=3 * measured.ffr_x.std())
