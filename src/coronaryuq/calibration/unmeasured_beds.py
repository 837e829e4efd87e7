"""Beds whose flow is not measured, those of the right ventricle, the septum and the atria: what is assumed of them.

Their share of conductance beside the LV-perfusing beds follows Murray's law, flow as a power n of the outlet's radius.
Its exponent is not known, nor are the radii exactly: an outlet of 0.6 mm with an error of 0.12 mm has 0.6 to 1.7 times
the flow. Nor do all beds conduct equally. What these beds draw passes the stenoses upstream of them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.lumen.profiles import Lumen, lumen_of
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.parameter_names import UNMEASURED
from coronaryuq.case.settings import MURRAY_EXPONENT
from coronaryuq.zerod.network.beds import beds

LEAST = 1e-6
"""Effects of a coordinate on the logarithm of a radius that are left out."""


def median_radii(outlets: Sequence[CaseOutlet], network: Network) -> list[float]:
    """Return the radius (cm) of each outlet, where the lumen is uncertain its median."""
    lumen = lumen_of(network)
    if lumen is None:
        return [outlet.radius for outlet in outlets]
    return [outlet.radius * float(np.exp(lumen.at_end(outlet.vessel)[0])) for outlet in outlets]


def unmeasured_parameters(
    outlets: Sequence[CaseOutlet], network: Network, errors: RoutineErrors, exponent: float = MURRAY_EXPONENT
) -> list[dict[str, Any]]:
    """Return what is assumed of the beds without measured flow as entries of `uncertain_parameters`.

    `murray_exponent`: a larger exponent gives wider outlets a larger share beside the LV-perfusing beds together.
    `unmeasured_ARTERY`: a factor on the resistance of all such beds of an artery. It follows the outlets' radii in the
    drawn lumen, through that lumen's coordinates, and has the spread of conductance among beds.

    Parameters
    ----------
    outlets
        All coronary outlets.
    network
        Its beds, and its part `lumen` if the lumen is uncertain.
    errors
        `murray_exponent`, `microvascular` and `microvascular_correlation` are used.
    exponent
        Of Murray's law, at its centre.
    """
    unmeasured = [outlet for outlet in outlets if outlet.perfuses != "LV"]
    if not unmeasured:
        return []
    known, lumen = beds(network), lumen_of(network)
    radius = dict(zip((outlet.bc for outlet in outlets), median_radii(outlets, network), strict=True))
    measured = _Group([outlet for outlet in outlets if outlet.perfuses == "LV"], radius, lumen, exponent)
    entries: list[dict[str, Any]] = []
    if errors.murray_exponent > 0.0:
        logs = {outlet.bc: float(np.log(radius[outlet.bc])) for outlet in unmeasured}
        targets = {
            f"{bc}.{key}": measured.log_radius - log for bc, log in logs.items() for key in known[bc].resistances
        }
        entries.append(
            {"name": "murray_exponent", "distribution": "lognormal", "centre": 1.0, "spread": errors.murray_exponent}
            | {"kind": "factor", "targets": targets, "unit": "1", "source": "Zhou et al. 1999; Murray 1926"}
            | {"meaning": "e to the change of Murray's exponent of unmeasured outlets"}
        )
    for artery in dict.fromkeys(outlet.branch for outlet in unmeasured):
        own = _Group([outlet for outlet in unmeasured if outlet.branch == artery], radius, lumen, exponent)
        correlation = errors.microvascular_correlation
        spread = errors.microvascular * np.sqrt(correlation + (1.0 - correlation) * own.concentration)
        moved = {
            name: own.errors.get(name, 0.0) - measured.errors.get(name, 0.0) for name in own.errors | measured.errors
        }
        loadings = {name: -exponent * value for name, value in moved.items() if abs(value) > LEAST}
        if spread == 0.0 and not loadings:
            continue
        targets = {f"{bed}.{key}": 1.0 for bed in own.names for key in known[bed].resistances}
        entries.append(
            {"name": f"{UNMEASURED}{artery}", "distribution": "lognormal", "centre": 1.0, "spread": float(spread)}
            | {
                "kind": "factor",
                "targets": targets,
                "unit": "1",
                "source": "Murray's law, errors of the outlets' radii",
            }
            | {"meaning": f"resistance of the beds of the {artery} without measured flow"}
            | ({"loadings": loadings} if loadings else {})
        )
    return entries


class _Group:
    """Some outlets, weighed by their flow by Murray's law: mean of the logarithm of the radius, and of its error.

    errors: coordinate of the lumen → coefficient. concentration: sum of the squared weights, one over the number of
    equal outlets.
    """

    def __init__(
        self, outlets: Sequence[CaseOutlet], radius: Mapping[str, float], lumen: Lumen | None, exponent: float
    ):
        self.names = [outlet.bc for outlet in outlets]
        radii = np.array([radius[name] for name in self.names])
        weight = radii**exponent / np.sum(radii**exponent)
        self.log_radius = float(weight @ np.log(radii))
        self.concentration = float(weight @ weight)
        self.errors: dict[str, float] = {}
        for outlet, share in zip(outlets, weight.tolist(), strict=True):
            for name, coefficient in ({} if lumen is None else lumen.at_end(outlet.vessel)[1]).items():
                self.errors[name] = self.errors.get(name, 0.0) + share * coefficient
