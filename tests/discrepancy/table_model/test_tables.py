"""Tables of pairs are joined, checked and split into branches."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.table_model.tables import zero_flow_pressure
from support.pair_tables import ZERO_FLOW, noisy_pairs, read_branch, rewrite


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [{}, {"gain": -0.04}, {"flow_gain": 0.15}, {"quadratic": 1.2}])
@pytest.mark.parametrize("outlet", [0.003, 0.01, 0.02])
def test_noise_does_not_produce_a_zero_flow_pressure(tmp_path, hidden, outlet):
    """If flow hardly changes, the estimate stays near zero: within half a prior standard deviation (0.1 of the root
    pressure) on average and two in each trial."""
    found = [read_branch(noisy_pairs(tmp_path, seed, outlet=outlet, **hidden)) for seed in range(20)]
    shares = [branch.venous / branch.root0.mean() for branch in found]
    assert np.mean(shares) < 0.05 and max(shares) < 0.2


def test_a_nearly_closed_artery_leaves_the_zero_flow_pressure_uncertain():
    """The distal pressures bound the estimate from above, where the factor of the bed would become negative."""
    read = {"p": np.full(50, 5.0), "q": 1e-4 * np.linspace(1.0, 2.0, 50), "root": np.full(50, 90.0)}
    made = {"p": np.linspace(70.0, 80.0, 50), "q": np.linspace(1.0, 2.0, 50), "root": np.full(50, 90.0)}
    root, bed = ("mean_pressure", "heart"), ("mean_pressure", "BC")
    pressures, flows = {root: ("root", "root"), bed: ("p", "p")}, {("mean_flow", "BC"): ("q", "q")}
    venous, spread = zero_flow_pressure(pd.DataFrame(made), pd.DataFrame(read), pressures, flows, root)
    assert venous < 5.0 and np.isfinite(spread)


def test_an_outlet_must_be_in_both_tables(tmp_path):
    files = noisy_pairs(tmp_path, 1)
    rewrite(files[1], lambda table: table.drop(columns=["mean_pressure:v1:BC"]))
    with pytest.raises(InputError, match="no outlet has both"):
        read_branch(files)


@pytest.mark.slow
@pytest.mark.parametrize("outlet", [0.001, 0.01, 0.02])
def test_the_zero_flow_pressure_is_estimated_if_flow_changes(tmp_path, outlet):
    """The mean over trials is within three standard errors, plus a bias due to the prior."""
    found = [read_branch(noisy_pairs(tmp_path, seed, quadratic=14.0, outlet=outlet)).venous for seed in range(40)]
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert np.std(found) < 100.0 * outlet + 0.5
    assert abs(np.mean(found) - ZERO_FLOW) < 3.0 * error + 0.5


@pytest.mark.parametrize(("of_pressure", "of_flow"), [(0.002, 0.05), (0.01, 0.03), (0.02, 0.02), (0.01, 0.0)])
def test_the_zero_flow_pressure_does_not_depend_on_which_reading_is_noisier(of_pressure, of_flow):
    """With equal errors of both taken for granted, it was 36 to 67 mmHg in place of 5 where flows are the noisier. Ten
    beds leave its prior little weight: the mean of 30 trials is within three standard errors of the truth, and 0.5."""
    random, count, found = generator(1, "test", "zero-flow pressure"), 120, []
    root, others = ("mean_pressure", "heart"), [f"b{number}" for number in range(10)]
    pressures = {("mean_pressure", name): (f"p_{name}",) * 2 for name in others} | {root: ("root", "root")}
    flows = {("mean_flow", name): (f"q_{name}",) * 2 for name in others}
    for _ in range(30):
        made = {"root": random.normal(92.0, 8.0, count)}
        read = {"root": made["root"]}
        for name in others:
            bed, loss = random.lognormal(0.0, 0.25, count) * 60.0, random.uniform(5.0, 15.0)
            resistances = {"made": (made, 2.0), "read": (read, 2.0 + loss)}
            for table, series in resistances.values():
                flow = (made["root"] - ZERO_FLOW) / (bed + series)
                table[f"p_{name}"], table[f"q_{name}"] = ZERO_FLOW + bed * flow, flow
            read[f"p_{name}"] = read[f"p_{name}"] * (1.0 + of_pressure * random.standard_normal(count))
            read[f"q_{name}"] = read[f"q_{name}"] * (1.0 + of_flow * random.standard_normal(count))
        found.append(zero_flow_pressure(pd.DataFrame(made), pd.DataFrame(read), pressures, flows, root))
    values, spreads = np.array(found).T
    assert abs(values.mean() - ZERO_FLOW) < 3.0 * values.std(ddof=1) / np.sqrt(30.0) + 0.5
    assert 0.5 < np.sqrt(np.mean(((values - ZERO_FLOW) / spreads) ** 2)) < 1.6


def with_neighbour(table, apart):
    """Add a second pressure, `apart` times the distal one, with another flow."""
    flow = 0.5 * table["mean_flow:v0:J"]
    return table.assign(**{"mean_pressure:v9:J9": apart * table["mean_pressure:v0:J"], "mean_flow:v9:J9": flow})


@pytest.mark.parametrize("shown", ["%.6f", "%.4f", "%.3f", "%.2f", "%.6g", "%.4g", "%.3g"])
def test_the_distal_pressure_is_found_in_a_rounded_table(tmp_path, shown):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    exact = read_branch(files)
    rewrite(files[0], lambda t: with_neighbour(t, 0.97).map(lambda v: v if isinstance(v, str) else float(shown % v)))
    branch = read_branch(files)
    assert branch.place == "v0:J" and branch.flow0 == pytest.approx(exact.flow0, rel=0.06)
    assert branch.distal0 == pytest.approx(exact.distal0, rel=0.01)


@pytest.mark.parametrize(("decimals", "apart"), [(12, 1.0001), (4, 1.0005), (3, 1.005), (2, 1.02), (1, 1.02)])
def test_a_different_pressure_is_not_mistaken_for_rounding(tmp_path, decimals, apart):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    rewrite(files[0], lambda t: with_neighbour(t, apart).drop(columns="mean_pressure:v0:J").round(decimals))
    with pytest.raises(InputError, match="no mean_pressure column equals FFR times the root pressure"):
        read_branch(files)


def test_two_pressures_that_rounding_cannot_distinguish_are_rejected(tmp_path):
    files = noisy_pairs(tmp_path, 1, quadratic=10.0)
    rewrite(files[0], lambda t: with_neighbour(t, 1.0002).assign(ffr_x=t["ffr_x"].round(2)))
    with pytest.raises(InputError, match=r"equals mean_pressure:v.:J.? and mean_pressure:v.:J.? within rounding"):
        read_branch(files)


def test_a_branch_in_only_one_table_is_noted(tmp_path, capsys):
    files = noisy_pairs(tmp_path, 1)
    rewrite(files[1], lambda table: table.assign(FFR_y=table["ffr_x"]))
    read_branch(files)
    assert f"note: {files[1]}: FFR_y: not in the other table" in capsys.readouterr().err


def test_an_empty_pressure_column_is_not_the_root_pressure(tmp_path):
    files = noisy_pairs(tmp_path, 1)
    for file in files:
        frame = pd.read_csv(file)
        frame.insert(1, "mean_pressure:away:away", np.nan if file == files[1] else 50.0)
        frame.to_csv(file, index=False)
    assert read_branch(files).root3.mean() == pytest.approx(84.5, abs=1.0)
