"""Parts of a 0D network have the names of the arteries on the page."""

from coronaryuq.case.anatomy.tree import AORTA
from coronaryuq.case.case_json import CaseOutlet, CaseStenosis
from coronaryuq.case.network.build import segments
from coronaryuq.case.network.network_names import InWords
from coronaryuq.synthetic.anatomy import patient_anatomy

IN_WORDS = InWords({"branch2": "LAD", "rca6": "PL1"}, {"BC_rca6": "PL1"})


def test_vessels_beds_and_places_have_readable_names():
    told = IN_WORDS(
        {"text": "pressure at rca6:BC_rca6, the resistance of BC_rca6", "rows": ["flow at J0:branch2_seg0"]}
    )
    assert told == {
        "text": "pressure at the end of PL1, the resistance of the PL1 bed",
        "rows": ["flow at LAD (part 1)"],
    }
    assert IN_WORDS("pressure at J_heart_outlet:aorta, waveform") == "pressure at the start of the aorta, waveform"
    assert IN_WORDS("loss at branch2_seg1:J7") == "loss at LAD (part 2)"
    assert IN_WORDS("quadratic stenosis at rca6 (loss 0.332)") == "quadratic stenosis at PL1 (loss 0.332)"


def test_other_words_and_pictures_stay():
    found = {"data": "data:image/png;base64,branch2_seg0", "caption": "Score: 3.2 at 0:5", "number": 4}
    assert IN_WORDS(found) == found


def test_the_parts_of_an_artery_are_numbered_through_its_bifurcations():
    """The first part behind every bifurcation of the LAD was its part 1."""
    anatomy = patient_anatomy()
    outlets = [
        CaseOutlet(
            name=o.vessel, label=o.label, bc=f"BC_{o.vessel}", vessel=o.vessel, block=o.vessel, perfuses=o.perfuses,
            branch=o.branch, point=anatomy.tree[o.vessel].points[-1].tolist(), radius=0.1,
        )
        for o in anatomy.outlets
    ]  # fmt: skip
    stenoses = [
        CaseStenosis(
            name=s.name, artery=s.name, vessel=s.vessel, segment=f"{s.vessel}_seg1", proximal=None, distal=None,
            area_ratio=0.2, start=s.start, end=s.end, ffr="a:b", flow="a:b", root="a:b", outlet="BC_lca1",
        )
        for s in anatomy.stenoses
    ]  # fmt: skip
    in_words = InWords.of(anatomy.tree, outlets, stenoses)
    parts = [part.name for part in segments(anatomy.tree, anatomy.stenoses)]
    words = [in_words(name) for name in parts if anatomy.tree[name.split("_seg")[0]].branch != AORTA]
    assert len(set(words)) == len(words), "a name for each"
    assert in_words("branch2_seg0") == "LAD (part 1)" and in_words("branch3_seg0") == "LAD (part 4)"
    assert in_words("lca1") == f"LAD (part {sum(word.startswith('LAD (') for word in words)})"
    assert in_words("lca1:BC_lca1") == "the end of LAD"
