"""The stenoses of a case: arteries, 0D vessels, and the names of the quantities that are read of each."""

from pathlib import Path

from coronaryuq.case.anatomy.tree import Stenosis, Tree, area_ratio
from coronaryuq.case.case_json import Artery, Branch, CaseOutlet, CaseStenosis
from coronaryuq.case.description.fields import ARTERIES, Description, StenosisPlace
from coronaryuq.case.network.build import Segment, segments
from coronaryuq.case.network.throats import implied_bore
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError

FED: dict[Artery, tuple[Branch, ...]] = {"LM": ("LAD", "LCx"), "LAD": ("LAD",), "LCx": ("LCx",), "RCA": ("RCA",)}
"""Branches of the outlets that each artery feeds."""
MAIN_LABELS: dict[Artery, tuple[str, ...]] = {
    "LM": ("LAD",),
    "LAD": ("LAD",),
    "LCx": ("LCx", "PDA"),
    "RCA": ("RCA", "PDA"),
}
"""Labels of the outlet at each artery's own end; the dominant artery ends as the PDA."""


def case_stenoses(
    path: Path,
    description: Description,
    tree: Tree,
    stenoses: list[Stenosis],
    topology: Topology,
    outlets: list[CaseOutlet],
) -> list[CaseStenosis]:
    """Return the stenoses in the order of arteries, upstream first, matched to 0D vessels and outlets.

    Parameters
    ----------
    path
        The `case.yaml`, named in errors.
    description
        Its content.
    tree, stenoses
        Vessels of the anatomy and the stenoses that have an extent along them.
    topology
        The 0D network.
    outlets
        Coronary outlets of the case.

    Raises
    ------
    InputError
        If a 0D vessel is missing, or feeds none of the outlets of the stated artery.
    """
    parts = segments(tree, stenoses, topology.blocks)
    built = {p.stenosis: p.name for p in parts if p.stenosis}
    places = {} if description.stenoses == "auto" else {place.name: place for place in description.stenoses}
    by_name = {s.name: s for s in stenoses}
    result = []
    for name in places or by_name:
        stenosis, place = by_name.get(name), places.get(name)
        block = place.block if place is not None and place.block else None
        if block is None and description.network is None:
            block = built[name]
        if block is None or block not in topology.vessels:
            raise InputError(path, f"stenoses.{name}.block", block, "not a vessel of the given network")
        artery = _artery(path, name, place, stenosis, tree, block, topology, outlets)
        parents, children = topology.parents(block), topology.children(block)
        if stenosis is None:
            bore = implied_bore(topology, block, description.density, description.blood_viscosity)
            ratio = None if bore is None or bore.ratio == 1.0 else bore.ratio
        else:
            ratio = area_ratio(tree, stenosis)
        result.append(
            CaseStenosis(
                name=name,
                artery=artery,
                vessel=stenosis.vessel if stenosis else block,
                segment=block,
                proximal=parents[0] if parents else None,
                distal=children[0] if children else None,
                area_ratio=ratio,
                start=stenosis.start if stenosis else None,
                end=stenosis.end if stenosis else None,
                ffr=topology.outlet(_read_behind(parts, stenosis, block)),
                flow=topology.inlet(block),
                root=topology.inlet(_branch_root(topology, block, artery, outlets)),
                outlet=_main_outlet(topology, block, artery, outlets),
                read=stenosis.read if stenosis else None,
            )
        )
    return sorted(result, key=lambda s: (ARTERIES.index(s.artery), len(topology.path(s.segment)), s.start or 0.0))


def _read_behind(parts: list[Segment], stenosis: Stenosis | None, block: str) -> str:
    """Return the 0D vessel at whose end FFR is read: the last before its place, or that of the stenosis."""
    if stenosis is None or stenosis.read is None:
        return block
    place = stenosis.read.arc
    return min((p for p in parts if p.vessel == stenosis.vessel), key=lambda part: abs(part.end - place)).name


def _artery(
    path: Path, name: str, place: StenosisPlace | None, stenosis: Stenosis | None, tree: Tree, block: str,
    topology: Topology, outlets: list[CaseOutlet],
) -> Artery:  # fmt: skip
    """Return the artery of a stenosis: the stated one, its vessel's, or that of the outlets which it feeds."""
    fed = {outlet.branch for outlet in outlets if outlet.bc in topology.outlets_below(block)}
    artery = place.stated_artery if place is not None else None
    if artery is None and stenosis is not None:
        artery = next((known for known in ARTERIES if known == tree[stenosis.vessel].branch), None)
    if artery is None:
        artery = next(iter(fed)) if len(fed) == 1 else "LM" if fed == set(FED["LM"]) else None
    if artery is None or not fed & set(FED[artery]):
        remedy = f"feeds {', '.join(sorted(fed)) or 'no coronary outlet'}; "
        remedy += f"choose a vessel upstream of an {artery} outlet" if artery else "state its artery"
        raise InputError(path, f"stenoses.{name}.block", block, remedy)
    return artery


def _branch_root(topology: Topology, block: str, branch: Artery, outlets: list[CaseOutlet]) -> str:
    """Return the first vessel towards `block` that feeds only outlets of that branch."""
    of_branch = {outlet.bc for outlet in outlets if outlet.branch in FED[branch]}
    return next((v for v in topology.path(block) if set(topology.outlets_below(v)) <= of_branch), block)


def _main_outlet(topology: Topology, block: str, branch: Artery, outlets: list[CaseOutlet]) -> str:
    """Return the artery's own end behind the stenosis: the one labelled as the artery, else the farthest."""
    fed = [outlet for outlet in outlets if outlet.bc in topology.outlets_below(block)]
    candidates = [outlet for outlet in fed if outlet.perfuses == "LV"] or fed

    def distance(outlet: CaseOutlet) -> float:
        path = topology.path(outlet.block)
        return sum(topology.length(v) for v in path[path.index(block) :])

    return max(candidates, key=lambda outlet: (outlet.label in MAIN_LABELS[branch], distance(outlet))).bc
