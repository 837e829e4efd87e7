"""An unknown source of flow at a node: its waveform, its place, and the law that it follows."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide, read_case
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all
from coronaryuq.discrepancy.selection.answer import NOTHING, OTHER, answer
from coronaryuq.discrepancy.selection.answer import SOURCE as ANSWER_SOURCE
from coronaryuq.discrepancy.selection.search import recalibrate
from coronaryuq.discrepancy.selection.unknown_source import FREE, POINTS, source_changes, unknown_source
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.flow_source import HARMONICS, FlowSource, basis
from coronaryuq.zerod.effects.library import LIBRARY, effect
from support.small_loop import loop

SOURCE = FlowSource()


def problem_of(folder, effects=(), outside="", strength="strong", seed=100):
    truth, _ = hide(Case(effects, strength, "nominal", seed, outside), open_loop(), folder)
    assert truth is not None
    problem, fit = recalibrate(read_case(folder))
    return truth, problem, fit


def test_the_source_takes_the_waveform_of_its_weights_in_every_condition(tmp_path):
    _, problem, _ = problem_of(tmp_path, strength="none")
    forward, phase = problem.forward, np.arange(POINTS) / POINTS
    asked = [
        Measured(name, "flow", "source_lad:BC_source_lad", "waveform", phase * T, T, np.ones(POINTS), np.ones(POINTS))
        for name, T in forward.periods.items()
    ]
    weights = np.random.default_rng(1).normal(size=len(SOURCE.parameters))
    z = np.concatenate([np.zeros(problem.count), weights])
    hypothesis = Hypothesis((PlacedEffect(SOURCE, "lad"),))
    found = replace(forward, measured=asked, shapes=None).predict(z, hypothesis)[0].reshape(-1, POINTS)
    sds = [float(one.from_standard(1.0)) for one in SOURCE.parameters]
    wave = forward.anatomy.flow_scale("lad") * (weights * sds) @ basis(phase)
    # The solver's steps are straight lines between its points: (pi h / steps)^2 / 2 of the h-th harmonic.
    bend = (np.pi * HARMONICS / problem.settings.steps_per_cycle) ** 2 / 2
    assert np.abs(found - wave).max() < 2 * bend * np.abs(wave).max()


def test_a_source_beside_an_error_of_a_probe_changes_what_the_probe_reads(tmp_path):
    """A probe that reads 1.2 times the flow shows 1.2 times the change; others show the same as without it."""
    _, problem, fit = problem_of(tmp_path, strength="none")
    gain = PlacedEffect(effect("flow_gain"), "J0:lad_proximal")
    size = 0.2 / float(gain.effect.parameters[0].from_standard(1.0))
    plain = source_changes(problem, fit.z, PLAIN)["lad"]
    beside = source_changes(problem, np.append(fit.z, size), Hypothesis((gain,)))["lad"]
    series = problem.forward.measured
    read = np.array([(one.quantity, one.location) == ("flow", gain.place) for one in series])[problem.owner]
    assert 0 < read.sum() < len(read) and np.abs(plain[read]).max() > 0.0
    assert beside == pytest.approx(np.where(read, 1.2, 1.0)[:, None] * plain, rel=1e-6, abs=1e-6 * np.abs(plain).max())


def test_a_closed_loop_has_no_node():
    assert SOURCE.places(Anatomy(loop())) == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "law"), [("side_branch_leak", "leak"), ("epicardial_compliance", "storage")])
def test_an_effect_that_nobody_listed_is_found_by_place_law_and_size(tmp_path, name, law):
    """Both are effects of the library, of which the source knows nothing; their sizes are those of the source."""
    truth, problem, fit = problem_of(tmp_path, (name,))
    nodes, source = unknown_source(problem, fit.z, PLAIN, source_changes(problem, fit.z, PLAIN))
    (placed,) = truth.hypothesis
    near = [vessel for vessel, nats in nodes if nats > nodes[0][1] - RULE.class_odds]
    assert nodes[0][1] > 10 and placed.place in near
    assert source.law == law and source.laws[law] > 0.9 and sum(source.laws.values()) == pytest.approx(1)
    if name == "side_branch_leak" and source.place == placed.place:
        size, sd = source.sizes["leak"]
        assert abs(size - truth.hypothesis.physical_sizes(truth.sizes)[0]["share"]) < 3.3 * sd


@pytest.mark.slow
def test_a_vessel_that_carries_blood_in_late_diastole_is_shown_by_its_waveform(tmp_path):
    """It follows no law of pressure and flow; blood leaves in the second half of the beat."""
    _, problem, fit = problem_of(tmp_path, outside="thrombosed_side_vessel", strength="medium")
    nodes, source = unknown_source(problem, fit.z, PLAIN, source_changes(problem, fit.z, PLAIN))
    assert nodes[0][1] > 10 and source.law == FREE
    for flow, sd in source.waveforms.values():
        assert flow[: POINTS // 3].mean() < flow[POINTS // 2 :].mean()
        assert np.all(sd > 0) and np.max(flow / sd) > 3


@pytest.mark.slow
def test_where_nothing_is_missing_no_node_adds_anything(tmp_path):
    _, problem, fit = problem_of(tmp_path, strength="none")
    nodes, _ = unknown_source(problem, fit.z, PLAIN, source_changes(problem, fit.z, PLAIN))
    assert len(nodes) == 5 and nodes[0][1] < RULE.class_odds


@pytest.mark.slow
@pytest.mark.parametrize("strength", ["none", "medium"])
def test_a_source_is_a_hypothesis_of_the_answer(tmp_path, strength):
    """Of the vessel that carries blood late in diastole, and of nothing, whose data it does not explain better."""
    outside = "" if strength == "none" else "thrombosed_side_vessel"
    _, problem, fit = problem_of(tmp_path, outside=outside, strength=strength)
    plain, changes = evidence_of_all(problem, fit, PLAIN), source_changes(problem, fit.z, PLAIN)
    found = answer(problem, plain, fit, PLAIN, [], LIBRARY, {}, changes)
    without = answer(problem, plain, fit, PLAIN, [], LIBRARY, {}, {})
    assert (found.given, without.given) == ((NOTHING, NOTHING) if strength == "none" else (OTHER, OTHER))
    more = found.log_evidence - without.log_evidence
    assert (found.leading_form == ANSWER_SOURCE and more > 10.0) if outside else abs(more) < 0.1
