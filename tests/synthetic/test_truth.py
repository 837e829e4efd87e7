"""The bundled patient is consistent with itself and plausible as a patient."""

import numpy as np
import pytest

from coronaryuq.core.units import MBF_PER_MIN_PER_G, MMHG, TISSUE_DENSITY
from coronaryuq.synthetic.truth import bed_name
from coronaryuq.zerod.network.beds import beds, distal_resistances
from coronaryuq.zerod.solver.engine import Engine


def wall_of(patient):
    volumes = np.abs(np.asarray(patient.wall.compute_cell_sizes(length=False, area=False)["Volume"]))
    return np.asarray(patient.wall.cell_centers().points), volumes, np.asarray(patient.wall.cell_data["MBF"])


def test_the_map_integrates_to_the_hyperaemic_flow_of_every_outlet(patient):
    centres, volumes, mbf = wall_of(patient)
    feeding = [outlet for outlet in patient.anatomy.outlets if outlet.perfuses == "LV"]
    ends = np.array([patient.anatomy.tree[outlet.vessel].points[-1] for outlet in feeding])
    nearest = np.argmin(((centres[:, None] - ends) ** 2).sum(axis=2), axis=1)
    flow = mbf * MBF_PER_MIN_PER_G * volumes * TISSUE_DENSITY
    for number, outlet in enumerate(feeding):
        expected = patient.hyperaemia.flows[bed_name(outlet.vessel)]
        assert flow[nearest == number].sum() == pytest.approx(expected, rel=1e-9)


def test_perfusion_is_that_of_a_patient_under_hyperaemia(patient):
    _, volumes, mbf = wall_of(patient)
    assert np.average(mbf, weights=volumes) == pytest.approx(patient.settings.mbf, rel=5e-4)
    low, high = np.percentile(mbf, [1, 99])
    assert low > 1.4
    assert high < 3.5


def test_perfusion_is_lower_distal_to_microvascular_disease(patient):
    flow, mass = dict.fromkeys(("LAD", "LCx", "RCA"), 0.0), dict.fromkeys(("LAD", "LCx", "RCA"), 0.0)
    for outlet in patient.anatomy.outlets:
        name = bed_name(outlet.vessel)
        if name in patient.masses:
            flow[outlet.branch] += patient.hyperaemia.flows[name]
            mass[outlet.branch] += patient.masses[name]
    perfusion = {artery: flow[artery] / mass[artery] for artery in flow}
    assert perfusion["LAD"] < 0.9 * perfusion["LCx"]
    assert perfusion["RCA"] < 0.97 * perfusion["LCx"]


def test_hyperaemia_raises_flow_and_lowers_ffr(patient):
    rest, hyperaemia = sum(patient.rest.flows.values()), sum(patient.hyperaemia.flows.values())
    assert 2.5 < hyperaemia / rest < 4.0
    assert 3.0 <= patient.rest.measures["AorCorSplit"] < 5.0
    for artery, ffr in patient.hyperaemia.ffr.items():
        assert 0.75 < ffr < 0.9, artery
        assert patient.rest.ffr[artery] > ffr


def test_the_heart_is_that_of_an_adult_at_rest(patient):
    values = patient.rest.measures
    assert values["PaoMean"] / MMHG == pytest.approx(patient.settings.mean_pressure, rel=5e-4)
    assert values["AbsQin"] == pytest.approx(patient.settings.stroke_volume, rel=5e-4)
    assert 55 < values["PaoMin"] / MMHG < 90 and 105 < values["PaoMax"] / MMHG < 145
    assert 0.5 < values["EFLV"] < 0.75
    assert 90 < values["EDV"] < 150
    assert 10 < values["PpulMean"] / MMHG < 22
    assert values["LCorMaxRatio"] > 1.2 and values["LCorTotRatio"] > 2.0  # the left coronary fills in diastole


def test_hyperaemia_changes_arterial_resistances_only(patient):
    rest = {bc["bc_name"]: bc["bc_values"] for bc in patient.rest.network["boundary_conditions"]}
    hyperaemia = {bc["bc_name"]: bc["bc_values"] for bc in patient.hyperaemia.network["boundary_conditions"]}
    coronary = beds(patient.rest.network)
    for name in rest:
        for member, value in rest[name].items():
            factor = patient.settings.hyperaemia if name in coronary and member in ("Ra", "Ram") else 1.0
            assert hyperaemia[name][member] == pytest.approx(value * factor, rel=1e-12)


@pytest.mark.parametrize("condition", ["rest", "hyperaemia"])
def test_the_written_state_is_periodic(patient, condition):
    """One cycle from the network's own initial condition repeats the flows of the truth."""
    state = getattr(patient, condition)
    names = {bed: f"mean_flow:{bed.removeprefix('BC_')}:{bed}" for bed in state.flows}
    result = Engine(state.network).run_cycles(quantities=list(names.values()), cycles=1, steps_per_cycle=500)
    for bed, name in names.items():
        assert result.values[name][0] == pytest.approx(state.flows[bed], rel=2e-3), bed


def test_resistances_per_gram_vary_between_beds(patient):
    resistance = distal_resistances(patient.rest.network)
    per_gram = [resistance[name] * mass for name, mass in patient.masses.items()]
    assert 0.03 < np.std(np.log(per_gram)) < 0.3
