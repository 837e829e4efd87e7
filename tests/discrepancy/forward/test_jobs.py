"""What a batch of runs changes is what each of them changes by itself."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.fast_settling import FastSettling
from coronaryuq.discrepancy.forward.jobs import Job, batches, stack
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from support.hypotheses import assume
from support.small_loop import STENOSIS, fresh, loop

LEAK = (effect("side_branch_leak"), "lca2")


@pytest.fixture(scope="module")
def forward():
    return fresh().forward


def jobs(forward, prepared, acting, count=5) -> list[Job]:
    z = generator(1, "jobs").standard_normal((count, len(forward.nuisances) + len(acting)))
    found = []
    for name in forward.conditions:
        each, scaled = forward.factors(prepared, name, z[:, : len(forward.nuisances)])
        for i, row in enumerate(z):
            sizes = acting.physical_sizes(row)
            effects = forward.effect_values(prepared, name, acting, sizes, forward.reference_pressure)
            found.append(Job(forward.point(row, acting), name, effects, each[i], scaled))
    return found


@pytest.mark.parametrize("acting", [assume(), assume(STENOSIS), assume(LEAK, STENOSIS)])
def test_stacked_parameters_equal_those_of_single_runs(forward, acting):
    prepared = forward.simulation.prepared(forward.simulation.inserting(acting))
    mixed = jobs(forward, prepared, acting)
    columns = stack(prepared, mixed)
    for number, job in enumerate(mixed):
        table = job.table(prepared)
        assert table.keys() <= columns.keys()
        for name, column in columns.items():
            assert column[number] == (table[name] if name in table else prepared.own(job.condition, name))


def test_a_nuisance_factor_multiplies_the_value_set_by_an_effect(forward):
    """Haematocrit thickens a bed's blood, recalibration scales its resistance."""
    thick = (effect("haematocrit"), effect("haematocrit").places(forward.anatomy)[0])
    prepared, z = forward.simulation.prepared([]), np.zeros(len(forward.nuisances) + 1)
    z[-1] = 1.0
    column = next(i for i, n in enumerate(forward.nuisances) if n.name == "resistance of BC_lca1")
    plain, thickened, both = z.copy(), z.copy(), z.copy()
    plain[column] = both[column] = 0.7
    tables = []
    for row, acting in ((plain, assume()), (thickened, assume(thick)), (both, assume(thick))):
        each, scaled = forward.factors(prepared, "rest", row[None, :-1])
        effects = forward.effect_values(
            prepared, "rest", acting, acting.physical_sizes(row), forward.reference_pressure
        )
        tables.append(Job(forward.point(row, acting), "rest", effects, each[0], scaled).table(prepared))
    own = prepared.own("rest", "BC_lca1.Ra")
    scale, thicker, found = (table["BC_lca1.Ra"] / own for table in tables)
    assert scale > 1.0 and thicker != 1.0
    assert found == pytest.approx(scale * thicker)


def test_runs_that_differ_only_in_tissue_mass_are_one(forward):
    prepared = forward.simulation.prepared([])
    one, other, *_ = jobs(forward, prepared, assume())
    same = Job(other.point, one.condition, one.effects, one.factors, one.scaled)
    assert one.key != other.key and one.key == same.key


def test_runs_that_activate_zero_valued_elements_are_a_batch_of_their_own(forward):
    acting = assume(STENOSIS)
    prepared = forward.simulation.prepared(forward.simulation.inserting(acting))
    mixed = jobs(forward, prepared, assume(), 2) + jobs(forward, prepared, acting, 2)
    assert batches(prepared, mixed) == [[0, 1, 2, 3], [4, 5, 6, 7]]


def test_extrapolation_of_slow_modes_conserves_the_blood_volume():
    """One coronary bed empties in 4 s here, so that the loop has a slow mode, also with an element put in."""
    network = loop()
    network["boundary_conditions"][1]["bc_values"]["Cim"] *= 60.0
    problem = fresh(network)
    simulation = problem.forward.simulation
    plain, grafted = simulation.prepared([]), simulation.prepared(assume(STENOSIS))
    for prepared in (plain, grafted):
        mixed = jobs(problem.forward, prepared, assume())
        changes = stack(prepared, mixed)
        ahead = FastSettling().ahead(plain, prepared, mixed, changes, 200)
        start = np.array([prepared.start[job.condition] for job in mixed])[:, : 2 * prepared.engine.model.size]
        end, who = start * (1.0 + 0.01 * generator(2, "jobs").standard_normal(start.shape)), np.array([0, 3, 8])
        found, volume = ahead(who, start[who], end[who]), BloodVolume(prepared.engine.model)
        mine = {name: value[who] for name, value in changes.items() if value.ndim == 1}
        assert volume.evaluate(found, mine) == pytest.approx(volume.evaluate(end[who], mine), rel=1e-12)
        assert np.abs(found - end[who]).max() > 0.0
