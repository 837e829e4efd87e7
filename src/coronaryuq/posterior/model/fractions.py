"""Flow fractions, bed by bed: the targets, those of the fitted resistances, those of the posterior."""

from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.posterior.results import Chains

if TYPE_CHECKING:
    import pandas as pd


def fractions(outlets: list[str], volume: np.ndarray, resistances: np.ndarray, chains: Chains) -> "pd.DataFrame":
    """Return one row per LV-perfusing outlet; CGS, errors relative to the target fraction.

    outlets (N,): names. volume (N,): territories, cm3 (nan where not known). resistances (N,): Ra + Ram + Rv of r-hat.

    target_flow is that of the likelihood, scaled to the model's total. `fitted_*`: the resistances with the total of
    r-hat at which the model's flows have the target fractions. `posterior_*`: over the draws; the prior alone pulls the
    means of very small and very large beds off their targets by a few per cent (docs/explanation/total-resistance.md).
    """
    import pandas as pd

    wanted = _fraction(chains.target_mean)
    fitted = _fraction(chains.fit_flows)
    draws = chains.kept_multipliers.reshape(-1, len(outlets))
    simulated = _fraction(chains.kept_flows.reshape(-1, len(outlets)))
    return pd.DataFrame(
        {
            "outlet": outlets,
            "bc": chains.names,
            "volume": volume,
            "target_flow": chains.target_mean,
            "target_fraction": wanted,
            "r_hat": resistances,
            "fitted_multiplier": chains.fit_multipliers,
            "fitted_resistance": chains.fit_multipliers * resistances,
            "fitted_flow": chains.fit_flows,
            "fitted_fraction": fitted,
            "fitted_error": fitted / wanted - 1.0,
            "posterior_multiplier": draws.mean(axis=0),
            "posterior_multiplier_sd": draws.std(axis=0, ddof=1),
            "posterior_fraction": simulated.mean(axis=0),
            "posterior_fraction_sd": simulated.std(axis=0, ddof=1),
            "posterior_error": simulated.mean(axis=0) / wanted - 1.0,
        }
    )


def _fraction(flows: np.ndarray) -> np.ndarray:
    return flows / flows.sum(axis=-1, keepdims=True)
