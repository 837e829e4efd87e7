"""What recalibration may move where a conditions file says that it is unknown."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import BED_SHAPE, RESISTANCE, Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.forward.nuisance import nuisances
from coronaryuq.discrepancy.hidden.make_case import Noise, hide
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.search_case import search_case
from coronaryuq.discrepancy.selection.candidates import COMPLIANCE, all_candidates
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.grafting import put_ahead
from coronaryuq.zerod.network.read import read_network
from support import large_aorta
from support.hypotheses import assume

LOSS = 4e4


def measured(*conditions):
    return [
        Measured(one.name, "pressure", "lad:BC_lad", "mean", None, 0.85, np.array([1e5]), np.array([1e3]))
        for one in conditions
    ]


def problem(network, *conditions):
    return make_problem(network, {one.name: one for one in conditions}, measured(*conditions), Settings())


def test_the_shape_of_the_beds_is_free_if_a_condition_lists_it():
    plain, free = Condition("rest"), Condition("rest", free=(BED_SHAPE,))
    names = [{n.name: n.targets for n in problem(left_coronary(), one).forward.nuisances} for one in (plain, free)]
    added = {name: targets for name, targets in names[1].items() if name not in names[0]}
    assert set(added["proximal resistance of the beds"]) == {f"BC_{bed}.Ra1" for bed in ("lad", "diagonal", "lcx")}
    assert set(added["proximal compliance of the beds"]) == {f"BC_{bed}.Ca" for bed in ("lad", "diagonal", "lcx")}
    assert "lad.C" in added["compliance of the vessels"] and len(added) == 3
    assert not free.anchored and Condition("rest", free=(RESISTANCE,)).anchored


def with_a_place_for_a_loss():
    network = put_ahead(left_coronary(), "lad", "loss")
    network.vessel_values("lad_loss")["stenosis_coefficient"] = 0.0
    return network


def test_a_block_that_a_condition_scales_is_scaled_by_a_factor_known_to_ten_percent():
    """As its coronary resistance is; it had been exact, and an error of it was something else."""
    network, drug = left_coronary(), Condition("drug", scale={"BC_lad": {"Ra1": 1.3, "Ra2": 1.3}})
    asked = problem(network, Condition("rest"), drug)
    (column,) = [k for k, one in enumerate(asked.forward.nuisances) if one.name == "scale of BC_lad under drug"]
    moved = np.zeros((2, asked.count))
    moved[1, column] = 1.0
    (rest, other), (same, changed) = asked.forward.predict(moved)
    exact = problem(
        network, Condition("rest"), replace(drug, scale={"BC_lad": dict.fromkeys(("Ra1", "Ra2"), 1.3 * np.exp(0.1))})
    )
    assert same == rest and changed != other
    assert changed == pytest.approx(exact.forward.predict(np.zeros(asked.count))[0, 1], rel=1e-7)


def test_a_stenosis_with_one_name_has_one_severity():
    rest = Condition("rest")
    clamped = {"set": {"lad_loss": {"stenosis_coefficient": LOSS}}, "stenosis": {"lad_loss": "mild"}}
    both = [Condition(name, **clamped) for name in ("mild", "mild dilated")]
    forward = problem(with_a_place_for_a_loss(), rest, *both).forward
    (column,) = [i for i, n in enumerate(forward.nuisances) if n.name == "stenosis mild of lad_loss"]
    nought = np.zeros(len(forward.nuisances))
    severe = nought.copy()
    severe[column] = 0.5
    before, after = forward.predict(nought)[0], forward.predict(severe)[0]
    assert after[0] == pytest.approx(before[0])
    assert (after[1:] < before[1:] - 1e3).all()
    # As a network whose loss is so much greater.
    greater = copy.deepcopy(clamped)
    greater["set"]["lad_loss"]["stenosis_coefficient"] *= np.exp(Settings().sd_stenosis * 0.5)
    written = problem(with_a_place_for_a_loss(), rest, *(Condition(c.name, **greater) for c in both)).forward
    assert written.predict(nought)[0] == pytest.approx(after, rel=1e-6)


def test_the_severity_of_a_stenosis_does_not_scale_an_effect():
    """Severity scales the loss that a condition has, not what an effect adds to it."""
    clamped = {"set": {"lad_loss": {"stenosis_coefficient": LOSS}}, "stenosis": {"lad_loss": "mild"}}
    conditions = Condition("rest"), Condition("mild", **clamped)
    forward = problem(with_a_place_for_a_loss(), *conditions).forward
    (column,) = [i for i, n in enumerate(forward.nuisances) if n.name == "stenosis mild of lad_loss"]
    acting, key = assume(("quadratic_stenosis", "lad_loss")), "lad_loss.stenosis_coefficient"

    def loss(condition, severity, acting=()):
        z = np.zeros(len(forward.nuisances) + len(acting))
        z[column] = severity
        table, network = forward.condition_changes(condition, z, assume(*acting))
        return table.get(key, network.vessel_values("lad_loss")["stenosis_coefficient"])

    added = [loss(name, severity, acting) - loss(name, severity) for name in ("rest", "mild") for severity in (0, 1)]
    assert min(added) > 0.0 and added == pytest.approx([added[0]] * 4)
    assert loss("mild", 1.0) == pytest.approx(loss("mild", 0.0) * np.exp(Settings().sd_stenosis))
    rows = [(np.r_[np.eye(len(forward.nuisances))[column] * severity, 0.0], acting) for severity in (0.0, 1.0)]
    together = forward.predict_rows(rows)
    # Runs in one batch are the network with the sums written in.
    for (z, _), predicted in zip(rows, together, strict=True):
        total = {"rest": loss("rest", z[column], acting), "mild": loss("mild", z[column], acting)}
        written = [Condition(name, set={"lad_loss": {"stenosis_coefficient": total[name]}}) for name in total]
        alone = problem(with_a_place_for_a_loss(), *written).forward
        assert alone.predict(np.zeros(len(alone.nuisances)))[0] == pytest.approx(predicted, rel=1e-5)


def test_a_vessel_added_ahead_is_not_a_place_of_its_own():
    places = {c.place for c in all_candidates(problem(with_a_place_for_a_loss(), Condition("rest")), assume())}
    assert "lad" in places and "lad_loss" not in places


@pytest.mark.parametrize(
    ("stenosis", "values", "said"),
    [
        ({"nowhere": "mild"}, {}, "no such vessel in the network; known: left_main"),
        ({"lad": "mild"}, {"lad": {"C": 1e-7}}, "has a C; add a vessel without C ahead"),
        ({"lad_loss": "mild"}, {}, "to an estimate under this condition"),
    ],
)
def test_an_invalid_stenosis_is_rejected(stenosis, values, said):
    with pytest.raises(InputError, match=said):
        apply_condition(with_a_place_for_a_loss(), Condition("x", set=values, stenosis=stenosis))


def test_recordings_with_a_free_bed_list_each_stenosis_once(tmp_path):
    import pandas as pd

    phase = np.linspace(0.0, 1.0, 60)
    beat = {"t": 0.5 * phase, "AoP [mmHg]": 80 + 20 * np.sin(2 * np.pi * phase)}
    beat |= {"LVP [mmHg]": 50 + 50 * np.sin(2 * np.pi * phase), "LAD Flow [ml/min]": 30 + 3 * np.cos(2 * np.pi * phase)}
    frame = pd.DataFrame(beat).rename(columns={"t": "t [s]"})
    for name in ("baseline", "mild_sten", "mild_sten_dob"):
        frame.to_csv(tmp_path / f"X_{name}.csv", index=False)
    for free_bed in (False, True):
        prepare_case(tmp_path, "X", tmp_path / "case", free_bed=free_bed)
        vessels = [v["vessel_name"] for v in read_network(tmp_path / "case" / "model.json")["vessels"]]
        assert ("lad_loss" in vessels) == free_bed
    text = (tmp_path / "case" / "conditions.yaml").read_text()
    assert text.count("lad_loss: mild_sten\n") == 2 and text.count("bed_shape") == 3


def test_a_beat_with_too_few_times_is_rejected_by_its_recording(tmp_path):
    """The last time is the first of the next beat: eight make seven readings, one fewer than a waveform wants."""
    import pandas as pd

    time = np.linspace(0.0, 0.5, 8)
    columns = {"t [s]": time, "AoP [mmHg]": 80.0 + time, "LVP [mmHg]": 50.0 + time, "LAD Flow [ml/min]": 30.0 + time}
    for name in ("baseline", "paced"):
        pd.DataFrame(columns).to_csv(tmp_path / f"X_{name}.csv", index=False)
    with pytest.raises(InputError, match="X_baseline.csv.*expected at least 9 over one beat"):
        prepare_case(tmp_path, "X", tmp_path / "case")


def test_a_gap_in_a_recording_is_rejected_by_its_line(tmp_path):
    import pandas as pd

    time = np.linspace(0.0, 0.5, 40)
    columns = {"t [s]": time, "AoP [mmHg]": 80.0 + time, "LVP [mmHg]": 50.0 + time, "LAD Flow [ml/min]": 30.0 + time}
    frame = pd.DataFrame(columns).astype({"LAD Flow [ml/min]": object})
    frame.loc[4, "LAD Flow [ml/min]"] = "x"
    for name in ("baseline", "paced"):
        frame.to_csv(tmp_path / f"X_{name}.csv", index=False)
    with pytest.raises(InputError, match="= 'x': line 6: expected a number"):
        prepare_case(tmp_path, "X", tmp_path / "case")


def test_a_vessel_with_a_declared_stenosis_gets_no_compliance():
    """What is put into it would make conditions that declare a stenosis there refuse the repaired network."""
    clamped = {"set": {"lad": {"C": 0.0, "stenosis_coefficient": LOSS}}, "stenosis": {"lad": "mild"}}
    for conditions, expected in (
        ((Condition("rest"),), True),
        ((Condition("rest"), Condition("mild", **clamped)), False),
    ):
        candidates = all_candidates(problem(left_coronary(), *conditions), assume())
        places = {c.place for c in candidates if c.effect.name == COMPLIANCE}
        assert "left_main" in places and ("lad" in places) == expected


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 6))])
def test_errors_of_bed_compliances_leave_nothing_to_explain(seed, tmp_path):
    """Independent errors of a tenth: with a single common factor they would look like gains and exchanged outlets."""
    experiment, random = open_loop(), generator(seed, "test", "scattered compliances")
    network = copy.deepcopy(experiment.network)
    for bed in network["boundary_conditions"]:
        if bed["bc_type"] == "CORONARY":
            factor = np.exp(0.1 * random.standard_normal())
            bed["bc_values"] |= {name: bed["bc_values"][name] * factor for name in ("Ca", "Cc")}
    hide(replace(experiment, network=network), assume(), np.zeros(0), Noise(), seed, tmp_path)
    paths = [tmp_path / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
    write_json(paths[0], experiment.network)
    answer = search_case(*paths, tmp_path / "found", Settings(), 1)
    assert not answer["alarm"] and answer["named"] == []


def test_every_systemic_bed_beside_coronary_ones_has_a_resistance_and_a_compliance_of_its_own():
    """They had shared one factor, and 5 % in two of them of opposite signs were a flow gain, at 0.89."""
    network = large_aorta.network()
    for name in ("BC_descending", "BC_lcx"):
        network.bed(name).update(bc_type="RCR", bc_values={"Rp": 120.0, "Rd": 1340.0, "C": 9e-4, "Pd": 4e3})
    found = {one.name: one for one in nuisances(network, {"rest": Condition("rest")}, [], Settings())}
    for bed in ("BC_descending", "BC_lcx"):
        assert found[f"resistance of {bed}"].targets == (f"{bed}.Rp", f"{bed}.Rd")
        assert found[f"compliance of {bed}"].targets == (f"{bed}.C",)
    assert set(found["systemic resistance"].targets) == {
        "BC_descending.Rp",
        "BC_descending.Rd",
        "BC_lcx.Rp",
        "BC_lcx.Rd",
    }
    assert found["coronary resistance"].targets and "resistance of BC_lad" not in found, "a single coronary bed"


def test_beds_of_a_tree_without_coronary_ones_are_not_called_coronary():
    network = large_aorta.network()
    for name in ("BC_descending", "BC_lad", "BC_lcx"):
        network.bed(name).update(bc_type="RESISTANCE", bc_values={"R": 2e4, "Pd": 4e3})
    used = {name: Condition(name) for name in ("rest", "exercise")}
    series = [replace(measured(condition)[0], condition=name) for name, condition in used.items()]
    names = [one.name for one in nuisances(network, used, series, Settings())]
    assert "bed resistance" in names and "bed state of exercise" in names and not any("coronary" in n for n in names)
