"""Everything beyond the mean of one row."""

from dataclasses import replace

from coronaryuq.estimation.estimators import sensitivity, shapley, tails
from coronaryuq.estimation.estimators.design import Design
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.estimators.sources import sources
from coronaryuq.estimation.results import BeyondTheMean
from coronaryuq.estimation.runs.table import Row, pair
from coronaryuq.estimation.settings import Settings

SHARES = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)
"""Ends of the ranges of 95, 90 and 50 %, and the median."""


def beyond_the_mean(design: Design, row: Row, predictions: Predictions, settings: Settings) -> BeyondTheMean:
    """Return everything beyond the mean of one row; zones are those of FFR, other quantities have none.

    A quantile whose coverage is not tested carries a warning.
    """
    y, _ = pair(design.runs, row)
    level = settings.level
    effects = shapley.effects(design, row, predictions, level, settings.input_groups)
    groups = sources(design.runs.inputs)
    by_source = shapley.effects(design, row, predictions, level, groups).shapley if groups else None
    return BeyondTheMean(
        variance=tails.variance(design, y, predictions, level),
        quantiles={
            _name(share): replace(
                tails.quantile(design, y, predictions, share, level), warning=tails.rare(len(y), share)
            )
            for share in SHARES
        },
        zones=tails.zones(design, y, predictions, settings.ffr_zones, level)
        if row.column_3d.lower().startswith(("ffr", "lowest_ffr"))
        else None,
        sobol_first_order=sensitivity.sobol(design, y, predictions, level),
        sobol_total=effects.total,
        shapley=effects.shapley,
        by_source=by_source,
    )


def _name(share: float) -> str:
    """Return a share with as many decimals as it needs, two at least."""
    return f"{share:.3f}".removesuffix("0")
