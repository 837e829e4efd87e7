"""Names of the quantities of a run, a statistic of an unknown: `mean_flow:A:B`, `max_V_LV:CLH`."""

from dataclasses import dataclass

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Model

STATISTICS = ("mean", "min", "max")


@dataclass(frozen=True)
class Quantity:
    """A statistic over the last cycle of one unknown: the mean is trapezoidal, min and max are over the steps."""

    statistic: str
    unknown: int


def parse(name: str, model: Model) -> Quantity:
    """Parse `STATISTIC_UNKNOWN`, with svZeroDSolver's name of the unknown; `InputError` if there is none."""
    statistic, _, variable = name.partition("_")
    if statistic not in STATISTICS:
        raise InputError(model.file, name, None, f"expected a name that begins with {', '.join(STATISTICS)} and _")
    return Quantity(statistic, unknown(variable, model))


def unknown(name: str, model: Model) -> int:
    """Return the number of an unknown such as `flow:A:B`."""
    if name not in model.index:
        where = name.split(":", 1)[-1]
        near = [other for other in model.variables if where.split(":")[0] in other.split(":")][:6]
        raise InputError(model.file, name, None, f"no such unknown; similar: {', '.join(near) or 'none'}")
    return model.index[name]


def inner_unknowns(unknowns: list[str]) -> list[str]:
    """Return the unknowns inside the heart and beds, which are not a flow or pressure between blocks."""
    return [name for name in unknowns if not name.startswith(("flow:", "pressure:"))]
