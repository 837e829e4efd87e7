"""Where 3D reads FFR: at the place of the case, as 0D, wherever the mesh is cut."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.ffr_place import with_ffr_places
from coronaryuq.case.anatomy.tree import Stenosis, throat
from coronaryuq.case.network.build import segments
from coronaryuq.flow3d.mesh.generation import regions
from coronaryuq.flow3d.mesh.generation.build import Built, kept_vessels
from coronaryuq.flow3d.mesh.geometry import extent, paths
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.synthetic.anatomy import patient_anatomy
from support.random_trees import random_tree

DOMAINS = ("segments", "trees")


def planes(tree, stenoses, domain):
    """The plane of every stenosis; only the elements of the mesh are missing, and no plane depends on them."""
    chosen = Settings(domain=domain)
    kept = kept_vessels(tree, stenoses, chosen)
    pieces = extent.pieces(tree, kept)
    surfaces = [Implicit(paths.paths(tree, kept, piece)) for piece in pieces]
    caps = [cap for piece in pieces for cap in paths.caps(tree, kept, piece)]
    built = Built(None, kept, caps, pieces, surfaces, [])
    return {s.name: regions.plane(tree, s, stenoses, built, chosen.ffr_diameters) for s in stenoses}


@pytest.mark.parametrize("domain", DOMAINS)
def test_both_models_read_the_bundled_patient_at_one_place(domain):
    """LCx and RCA branch 9 and 11 mm beyond the lesion: the mesh was cut before, and 3D read 3 mm before 0D."""
    anatomy = patient_anatomy()
    stenoses = with_ffr_places(anatomy.tree, anatomy.stenoses, 1.5)
    parts = segments(anatomy.tree, stenoses)
    for stenosis in stenoses:
        plane = planes(anatomy.tree, stenoses, domain)[stenosis.name]
        assert plane.vessel == stenosis.vessel
        assert plane.arc == pytest.approx(stenosis.read.arc, abs=1e-6)
        from_throat = stenosis.read.arc - throat(anatomy.tree, stenosis)[0]
        assert plane.distance_from_throat == pytest.approx(from_throat, abs=1e-3)
        # 0D has a node where one of its vessels ends.
        assert min(abs(part.end - plane.arc) for part in parts if part.vessel == stenosis.vessel) < 1e-6


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 3.0), st.sampled_from(DOMAINS))
def test_3d_reads_where_the_case_asks(seed, beyond, domain):
    tree, stenoses = random_tree(seed, generations=2)
    placed = with_ffr_places(tree, stenoses, beyond)
    for name, plane in planes(tree, placed, domain).items():
        stenosis = next(s for s in placed if s.name == name)
        vessel = tree[stenosis.vessel]
        point = vessel.position_at(stenosis.read.arc)
        assert plane.vessel == stenosis.vessel and plane.arc == pytest.approx(stenosis.read.arc, abs=1e-6)
        assert np.linalg.norm(np.array(plane.point) - point) < 0.02 * float(vessel.radius_at(plane.arc))


def test_a_lesion_up_to_a_bifurcation_is_read_beyond_it():
    """A cross-section at its end would hold parts of both daughters."""
    anatomy = patient_anatomy()
    vessel = anatomy.tree["branch8"]
    (stenosis,) = with_ffr_places(anatomy.tree, [Stenosis("LCx", "branch8", 2.0, vessel.length - 0.02)], 1.5)
    plane = planes(anatomy.tree, [stenosis], "trees")["LCx"]
    assert plane.vessel != "branch8" and plane.vessel in {child.name for child in anatomy.tree.children("branch8")}
