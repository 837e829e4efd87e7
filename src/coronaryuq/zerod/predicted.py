"""What a physician asks: the lowest FFR of each artery, pressure drops over lesions, FFR where a wire was read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.special import ndtr

from coronaryuq.case.anatomy.tree import AORTA, BRANCHES, Tree, Vessel
from coronaryuq.case.case_json import CaseSummary, CaseWirePlace
from coronaryuq.case.network.build import Segment, shape_integrals
from coronaryuq.core.units import MMHG

LOWEST, DROP, WIRE = "lowest FFR", "pressure drop", "FFR at a place"
RANGE = {"low": 0.05, "median": 0.5, "high": 0.95}
"""Quantiles by their columns."""
COMPARISON = ("measured", "sd", "difference", "expected_low", "expected_high", "within")
"""Of a row with a measured value, see `compared`."""
COLUMNS = ("quantity", "name", "artery", "vessel", "arc", "unit", *RANGE, *COMPARISON)


@dataclass(frozen=True)
class TreePressures:
    """Mean pressures of n states at both ends of 0D vessels.

    Parameters
    ----------
    tree
        The centreline tree.
    parts
        The 0D vessels along it.
    ends
        0D vessel → mean pressure (n,) at its start and at its end, dyn/cm2.
    aorta
        (n,) mean aortic pressure, dyn/cm2.
    """

    tree: Tree
    parts: Sequence[Segment]
    ends: Mapping[str, tuple[np.ndarray, np.ndarray]]
    aorta: np.ndarray

    def at(self, vessel: str, arc: float) -> np.ndarray:
        """Return the mean pressure (n,) at an arc length (cm) of a tree vessel, dyn/cm2.

        Within a 0D vessel the pressure falls as the viscous resistance 8 µ/π ∫ r⁻⁴ ds ahead of the place does.
        """
        along = [part for part in self.parts if part.vessel == vessel and part.name in self.ends]
        if not along:
            raise ValueError(f"no 0D vessel along {vessel}")
        part = next((part for part in along if arc <= part.end), along[-1])
        start, end = self.ends[part.name]
        return start + _share(self.tree[vessel], part, arc) * (end - start)


def _share(vessel: Vessel, part: Segment, arc: float) -> float:
    """Return the fraction of the viscous resistance of a 0D vessel that lies ahead of an arc length (cm)."""
    if arc <= part.start + 1e-9 or arc >= part.end:
        return float(arc >= part.end)
    ahead, whole = (vessel.between(part.start, end) for end in (arc, part.end))
    return float(shape_integrals(ahead.radii, ahead.arc)[0] / shape_integrals(whole.radii, whole.arc)[0])


def predictions(case: CaseSummary, pressures: TreePressures) -> pd.DataFrame:
    """Return one row per quantity, with `COLUMNS`: median and 90 % range over the states.

    The lowest FFR of an artery is that of each state at the ends of its 0D vessels; its place is where the median of
    FFR is lowest. `vessel` and `arc` (cm) say where a row is read; the pressure drop over a lesion is that between its
    two ends. The places of a pressure wire (`ffr_at`) have their FFR and, where it was measured, how it compares.
    """
    rows = [*_lowest(pressures), *_lesions(case, pressures), *_wire_places(case, pressures)]
    return pd.DataFrame(rows, columns=COLUMNS)


def _lowest(pressures: TreePressures) -> list[dict]:
    """Return the lowest FFR of every coronary artery, whether it has a stenosis or not."""
    rows = []
    for artery in (branch for branch in BRANCHES if branch != AORTA):
        parts = [p for p in pressures.parts if pressures.tree[p.vessel].branch == artery and p.name in pressures.ends]
        if not parts:
            continue
        places = [(part, end) for part in parts for end in (0, 1)]
        ffr = np.array([pressures.ends[part.name][end] / pressures.aorta for part, end in places])
        part, end = places[int(np.argmin(np.median(ffr, axis=1)))]
        where = {"artery": artery, "vessel": part.vessel, "arc": (part.start, part.end)[end]}
        rows.append({"quantity": LOWEST, "name": artery, **where, "unit": "1", **quantiles(ffr.min(axis=0))})
    return rows


def _lesions(case: CaseSummary, pressures: TreePressures) -> list[dict]:
    """Return the pressure drop over every lesion, mmHg."""
    rows = []
    for stenosis in case.stenoses:
        start, end = pressures.ends[stenosis.segment]
        where = {"artery": stenosis.artery, "vessel": stenosis.vessel, "arc": stenosis.end}
        drop = quantiles((start - end) / MMHG)
        rows.append({"quantity": DROP, "name": stenosis.name, **where, "unit": "mmHg", **drop})
    return rows


def _wire_places(case: CaseSummary, pressures: TreePressures) -> list[dict]:
    """Return FFR at every place of a pressure wire."""
    rows = []
    for place in case.ffr_at:
        ffr = pressures.at(place.vessel, place.arc) / pressures.aorta
        where = {"artery": place.artery, "vessel": place.vessel, "arc": place.arc, "unit": "1"}
        rows.append({"quantity": WIRE, "name": place.name, **where, **quantiles(ffr), **compared(place, ffr)})
    return rows


def compared(place: CaseWirePlace, ffr: np.ndarray) -> dict[str, float | str | None]:
    """Return how predicted FFR (n,) compares with the measured value of a place; empty without one.

    difference: median of the prediction minus the measured value. expected_low, expected_high: 90 % range in which the
    wire's reading is expected, that of the states together with the wire's own error if its `sd` is given; within:
    whether it lies there, `yes` or `no`.
    """
    if place.measured is None:
        return {}
    low, high = (_noisy_quantile(ffr, share, place.sd) for share in (RANGE["low"], RANGE["high"]))
    difference = float(np.median(ffr)) - place.measured
    within = "yes" if low <= place.measured <= high else "no"
    return dict(zip(COMPARISON, (place.measured, place.sd, difference, low, high, within), strict=True))


def _noisy_quantile(values: np.ndarray, share: float, sd: float | None) -> float:
    """Return a quantile of values to which an independent normal error is added."""
    if sd is None:
        return float(np.quantile(values, share))
    reach = 10 * sd
    return brentq(lambda x: np.mean(ndtr((x - values) / sd)) - share, values.min() - reach, values.max() + reach)


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return the quantiles of `RANGE`."""
    return {name: float(np.quantile(values, share)) for name, share in RANGE.items()}
