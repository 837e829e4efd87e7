"""Sources of uncertainty by the names of inputs."""

from coronaryuq.estimation.estimators.sources import sources


def test_flow_alone_has_no_sources_to_compare_and_others_are_grouped_by_what_is_measured():
    flow = ["BC_lca1", "BC_rca1", "R_cor_scaling"]
    assert sources(flow) == {}
    found = sources([*flow, "lumen_common", "lumen_LAD_rest", "heart_1", "hyperaemia", "viscosity", "unmeasured_RCA"])
    assert found == {
        "flow": flow,
        "lumen": ["lumen_common", "lumen_LAD_rest"],
        "cuff and echo": ["heart_1"],
        "model": ["hyperaemia", "viscosity", "unmeasured_RCA"],
    }
