"""A ready network with 22 outlets and a table of territories, through every stage up to the posterior."""

import json
import shutil

import numpy as np
import pytest

from coronaryuq.calibration import stage as calibration
from coronaryuq.calibration.settings import Settings as CalibrationSettings
from coronaryuq.case.case_json import read_case
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.io.tables import read_csv
from coronaryuq.perfusion import stage as perfusion
from coronaryuq.perfusion.settings import Settings as PerfusionSettings
from coronaryuq.posterior import stage as posterior
from coronaryuq.posterior.results import read_summary
from coronaryuq.posterior.settings import DreamSettings, Settings
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity

OUTSIDE = {"rca1", "rca2", "rca3", "rca4", "rca10"}


def write_real_case(data, folder):
    """17 of the 22 outlets perfuse the LV, with volumes from 1 to 30 cm3 and 2.0 to 3.0 mL/min/g."""
    network = json.loads((data / "svzerod_tuning_cgs.json").read_text())
    shutil.copy(data / "svzerod_tuning_cgs.json", folder / "network.json")
    shutil.copy(data / "coronary_cgs.csv", folder / "targets.csv")
    beds = {
        bed["bc_name"].removeprefix("BC_"): bed["bc_type"].endswith("Right")
        for bed in network["boundary_conditions"] if "Coronary" in bed["bc_type"]
    }  # fmt: skip
    rows = [f"{n},{'RV' if n in OUTSIDE else 'LV'},{'RCA' if right else 'LAD'}" for n, right in beds.items()]
    (folder / "outlets.csv").write_text("name,perfuses,branch\n" + "\n".join(rows) + "\n")
    lv = [name for name in beds if name not in OUTSIDE]
    random = np.random.default_rng(3)
    volume = np.exp(random.normal(0, 0.5, len(lv)))
    volume *= 110 / volume.sum()
    flow = volume * 1.05 * np.exp(random.normal(np.log(2.4), 0.1, len(lv)))
    (folder / "flows.csv").write_text(
        "name,flow,volume\n" + "".join(f"{n},{q:.3f},{v:.3f}\n" for n, q, v in zip(lv, flow, volume, strict=True))
    )
    (folder / "case.yaml").write_text(
        "name: real\nnetwork: network.json\noutlets: outlets.csv\ntargets: targets.csv\n"
        "territory_flows: {file: flows.csv, unit: mL/min}\nstenoses: [{name: LAD, block: branch20_seg0}]\n"
    )
    return dict(zip(lv, flow / flow.sum(), strict=True))


@pytest.mark.long
def test_17_target_fractions_of_a_22_outlet_network_are_met(shared, tmp_path):
    wanted = write_real_case(shared / "data" / "closed-loop-22", tmp_path)
    prepare_case(tmp_path / "case.yaml", CaseSettings(), tmp_path)
    case, lv, targets = (tmp_path / name for name in ("case.json", "lv.vtu", "targets.json"))
    noise = PerfusionSettings(realisations=500)
    perfusion.run_chunk(case, lv, noise, 1, 0, 500, tmp_path / "chunk.npz")
    perfusion.gather([tmp_path / "chunk.npz"], case, lv, noise, targets)
    brief = CalibrationSettings(candidates=16, starts=2, rounds=1, evaluations_per_parameter=2)
    calibration.tune(case, tmp_path / "network.json", targets, brief, 1, tmp_path, report=lambda line: None)
    loop = tmp_path / "hyperaemia.json"
    settings = Settings(dream=DreamSettings(generations=4000), rhat_limit=1.1)
    posterior.sample(case, loop, targets, settings, 1, tmp_path / "chains.npz")
    names = ("posterior.nc", "draws.csv", "summary.json", "fractions.csv", "fitted.json")
    out = posterior.GatheredFiles(*(tmp_path / name for name in names))
    posterior.gather(case, loop, targets, tmp_path / "chains.npz", settings, 1, out)

    summary, table = read_summary(out.summary), read_csv(out.fractions)
    assert summary.converged, summary.verdict
    assert dict(zip(table["outlet"], table["target_fraction"], strict=True)) == pytest.approx(wanted, rel=1e-4)
    assert len(table) == 17 and np.abs(table["fitted_error"]).max() < 1e-4
    vessels = {outlet.bc: outlet.vessel for outlet in read_case(case).outlets}
    quantities = [f"mean_flow:{vessels[bc]}:{bc}" for bc in table["bc"]]
    anew = Engine(read_network(out.fitted), out.fitted).run_to_periodic(
        {}, quantities=quantities, periodicity=Periodicity(tolerance=1e-5)
    )
    flows = np.array([anew.values[name][0] for name in quantities])
    error = flows / flows.sum() / table["target_fraction"] - 1
    print(f"fitted network run anew: largest error of a fraction {np.abs(error).max():.1e}; posterior mean "
          f"{table['posterior_error'].min():.3f} to {table['posterior_error'].max():.3f}")  # fmt: skip
    assert np.abs(error).max() < 1e-3
    assert summary.predictive.coverage_95 == 1.0
