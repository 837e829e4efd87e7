"""Initial division of total coronary conductance among the beds, before tuning (paper, section 2.3)."""

from collections.abc import Mapping, Sequence

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.network.build import murray_shares
from coronaryuq.case.network.network import Network
from coronaryuq.case.settings import MURRAY_EXPONENT

RESISTANCES = ("Ra", "Ram", "Rv")
COMPLIANCES = ("Ca", "Cim")


def shares(
    outlets: Sequence[CaseOutlet], radii: Sequence[float], flows: Mapping[str, float],
    exponent: float = MURRAY_EXPONENT,
) -> dict[str, float]:  # fmt: skip
    """Return each bed's fraction of total coronary conductance (boundary condition → fraction, sum 1).

    `outlets` as in `case.json`; `radii`: theirs, cm; `flows`: perfusion's mean flow of every bed that perfuses the left
    ventricle. Murray's law over all outlets, with `exponent`, gives the fraction of all LV-perfusing beds together,
    which is divided among them in proportion to their flows.
    """
    by_radius = murray_shares(radii, exponent)
    total = sum(flows.values())
    left_ventricle = sum(share for outlet, share in zip(outlets, by_radius, strict=True) if outlet.perfuses == "LV")
    return {
        outlet.bc: left_ventricle * flows[outlet.bc] / total if outlet.perfuses == "LV" else float(share)
        for outlet, share in zip(outlets, by_radius, strict=True)
    }


def share_out(network: Network, wanted: Mapping[str, float]) -> None:
    """Change the coronary beds of `network` in place to the given fractions of conductance, by boundary condition.

    The parallel resistance of all beds and the total of each compliance are preserved, and so are, within a bed, the
    proportions of Ra, Ram and Rv; compliances are proportional to conductance, so that every bed has the same time
    constants.
    """
    beds = {bc["bc_name"]: bc["bc_values"] for bc in network.boundary_conditions if bc["bc_name"] in wanted}
    totals = {name: sum(values[member] for member in RESISTANCES) for name, values in beds.items()}
    conductance = sum(1.0 / total for total in totals.values())
    compliances = {member: sum(values[member] for values in beds.values()) for member in COMPLIANCES}
    for name, values in beds.items():
        factor = 1.0 / (conductance * wanted[name]) / totals[name]
        for member in RESISTANCES:
            values[member] *= factor
        for member in COMPLIANCES:
            values[member] = compliances[member] * wanted[name]
