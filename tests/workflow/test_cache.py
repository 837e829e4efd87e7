"""Results shared between campaigns: what is the same is taken from the cache, what could differ is computed."""

import shutil

import pytest

from support.checkout import Checkout

pytestmark = pytest.mark.workflow

EXPENSIVE = {"mesh", "perfusion_chunk", "calibration", "posterior_chains", "flow3d_batch", "zerod_chunk"}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """What a first campaign has left."""
    folder = tmp_path_factory.mktemp("first")
    (folder / "cache").mkdir()
    Checkout(folder / "first", folder / "cache").pretend_done()
    return folder / "cache"


@pytest.fixture
def again(cache, tmp_path):
    """Runs another campaign with other settings or an edit on a copy of that cache; returns what it ran."""

    def run(settings=None, edit=None):
        second = Checkout(tmp_path / "second", shutil.copytree(cache, tmp_path / "cache"))
        for block, values in (settings or {}).items():
            second.settings.setdefault(block, {}).update(values)
        if edit:
            second.edit(edit)
        return second.pretend_done()

    return run


@pytest.mark.long
def test_another_quantity_recomputes_nothing_expensive(again):
    jobs = again(settings={"estimation": {"ffr_zones": [0.75]}})
    assert not EXPENSIVE & set(jobs)
    assert {"estimation_train", "zerod_resampled", "estimation", "report"} <= set(jobs)


@pytest.mark.long
def test_more_samples_add_only_the_new_ones(again):
    jobs = again(settings={"samples": {"n_3d": 24}})
    assert jobs["flow3d_batch"] == 1
    assert not {"mesh", "posterior_chains", "calibration"} & set(jobs)


@pytest.mark.long
def test_another_noise_level_recomputes_what_depends_on_it(again):
    jobs = again(settings={"perfusion": {"correlation_length": 2.0}})
    assert {"perfusion_chunk", "calibration", "posterior_chains", "flow3d_batch"} <= set(jobs)
    assert "mesh" not in jobs


@pytest.mark.long
def test_an_edited_module_never_gives_a_stale_result(again):
    jobs = again(edit="flow3d/fem/wall_shear.py")
    assert jobs["flow3d_batch"] == 2
    assert not {"posterior_chains", "zerod_chunk"} & set(jobs)
