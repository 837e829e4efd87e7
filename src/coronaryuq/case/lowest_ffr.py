"""The lowest FFR of each artery: over the ends of its branches and the places where FFR of its stenoses is read."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.case_json import CaseSummary

PRESSURE = "pressure:"


@dataclass(frozen=True)
class FfrPlaces:
    """Where the lowest FFR of an artery is sought.

    Parameters
    ----------
    ends
        0D pressure, `pressure:A:B`, at each coronary outlet of the artery.
    stenoses
        Names of its stenoses.
    """

    ends: tuple[str, ...]
    stenoses: tuple[str, ...]


def ffr_places(case: CaseSummary, unknowns: Iterable[str]) -> dict[str, FfrPlaces]:
    """Return the places of each artery that has outlets.

    Mean pressure falls along a vessel of the 0D model, so the lowest of the tree is at its ends; in 3D it may rise
    again behind a stenosis, so the places where FFR of stenoses is read are asked, too. The left main has no ends of
    its own. The same places serve 0D and 3D: an outlet is found by its boundary condition, which a 3D domain leaves in
    place, whatever becomes of the vessel ahead of it.

    Parameters
    ----------
    case
        The case.
    unknowns
        Unknowns of the 0D network. An artery is left out if the network lacks one of its boundary conditions.
    """
    at = {name.rsplit(":", 1)[1]: name for name in unknowns if name.startswith(PRESSURE)}
    found: dict[str, FfrPlaces] = {}
    for artery in dict.fromkeys(outlet.branch for outlet in case.outlets):
        beds = [outlet.bc for outlet in case.outlets if outlet.branch == artery]
        if all(bed in at for bed in beds):
            stenoses = tuple(stenosis.name for stenosis in case.stenoses if stenosis.artery == artery)
            found[artery] = FfrPlaces(tuple(at[bed] for bed in beds), stenoses)
    return found


def lowest_ffr(
    places: Mapping[str, FfrPlaces], at_ends: Mapping[str, np.ndarray], at_stenoses: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the lowest FFR of each artery, (samples,), by its name among the quantities, such as `lowest_ffr_lad`.

    Parameters
    ----------
    places
        Artery → its places.
    at_ends
        0D pressure of an end → FFR there, (samples,).
    at_stenoses
        Stenosis → its FFR, (samples,); one that is not in the 3D domain may lack.
    """
    return {
        f"lowest_ffr_{artery.lower()}": np.min(
            [*(at_ends[end] for end in of.ends), *(at_stenoses[name] for name in of.stenoses if name in at_stenoses)],
            axis=0,
        )
        for artery, of in places.items()
    }
