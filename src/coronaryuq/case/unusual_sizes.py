"""Notes on sizes that are possible but rare, so that a wrong unit, label or inlet is seen before a campaign."""

from coronaryuq.case.anatomy.tree import AORTA, Tree
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.core.units import MBF_PER_MIN_PER_G

LV_MASS = (40.0, 350.0)
"""g: twice beyond what cardiac magnetic resonance finds in healthy adults of either sex, about 60 to 180."""
FLOW = (0.4, 6.0)
"""mL/min/g on average: positron emission finds 0.6 to 1.3 at rest and 2 to 5 under hyperaemia in healthy hearts."""
GIANT = 0.8
"""cm: diameter from which a coronary aneurysm is called giant (AHA statement on Kawasaki disease, 2017)."""
AORTIC_INLET = (1.5, 6.0)
"""cm: diameter of the ascending aorta, 2 to 4 in healthy adults; it is replaced from 5.5 on."""

FROM_VALVE = 5.0
"""cm from the aorta's start to the ostia, at most: they lie 1 to 2 cm above the valve; a model may begin below it."""


def size_notes(tree: Tree, wall: Wall, tissue_density: float) -> tuple[str, ...]:
    """Return a note for each size outside of what most adult patients have.

    Parameters
    ----------
    tree
        Vessels with their branches, cm.
    wall
        The left ventricle, with `Volume` (cm3) and `MBF` (mL/s/g).
    tissue_density
        Density of myocardium, g/mL.
    """
    mass = wall.volume * tissue_density
    notes = []
    if not LV_MASS[0] <= mass <= LV_MASS[1]:
        notes.append(
            f"left ventricle: a wall of {mass:.3g} g, where most adults have {_range(LV_MASS)} g; check its unit, and "
            "whether label or table has the wall alone, without cavity and right ventricle"
        )
    flow = wall.flow(tissue_density) / mass / MBF_PER_MIN_PER_G
    if not FLOW[0] <= flow <= FLOW[1]:
        notes.append(f"left ventricle: {flow:.2g} mL/min/g on average, where most have {_range(FLOW)}; check the unit")
    for vessel in tree:
        if vessel.branch == AORTA:
            continue
        widest = 2 * float(vessel.radii[vessel.arc >= tree.emergence(vessel.name)].max(initial=0.0))
        if widest > GIANT:
            notes.append(
                f"vessel {vessel.name}: {10 * widest:.2g} mm in diameter, as only giant aneurysms have; if it is none, "
                "check the contour or point there"
            )
    inlet = 2 * float(tree.root.radii[0])
    if tree.root.branch == AORTA and not tree.root.made and not AORTIC_INLET[0] <= inlet <= AORTIC_INLET[1]:
        notes.append(
            f"aorta: {inlet:.2g} cm in diameter at its inlet, where most adults have {_range(AORTIC_INLET)}; check the "
            "unit, and that the inlet is the aorta's"
        )
    return (*notes, *_backwards(tree))


def _backwards(tree: Tree) -> tuple[str, ...]:
    """Return a note if all arteries leave a real aorta far from its start and near its end."""
    aortic = [v for v in tree if v.branch == AORTA and not v.made]
    if tree.root not in aortic:
        return ()
    arc = {v.name: sum(part.length for part in tree.path(v.name)) for v in aortic}
    ostia = [arc[v.parent] for v in tree if v.branch != AORTA and v.parent in arc]
    behind = max(arc.values()) - min(ostia, default=0.0)
    if not ostia or min(ostia) <= FROM_VALVE or behind >= min(ostia):
        return ()
    return (
        f"aorta: the first artery leaves it {min(ostia):.2g} cm from its start and {behind:.2g} cm from its end; does "
        "it run backwards, from the outlet to the valve?",
    )


def _range(bounds: tuple[float, float]) -> str:
    return f"{bounds[0]:g} to {bounds[1]:g}"
