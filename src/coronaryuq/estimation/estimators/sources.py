"""Inputs by what has to be measured better to know them better."""

from collections.abc import Sequence

from coronaryuq.case.network import parameter_names

FLOW, LUMEN, CUFF_AND_ECHO, MODEL = "flow", "lumen", "cuff and echo", "model"
ASSUMED = ("hyperaemia", "viscosity", "murray_exponent")
"""Uncertain parameters that are assumed rather than measured, besides those of beds without measured flow."""


def sources(inputs: Sequence[str]) -> dict[str, list[str]]:
    """Return source → its inputs; empty if flow alone is uncertain, as in the paper's setting.

    `lumen_...`: coordinates of the lumen; `heart_...`: latent coordinates of the tuned heart; the beds' multipliers and
    their common scaling follow from the measured flow.
    """
    found: dict[str, list[str]] = {FLOW: [], LUMEN: [], CUFF_AND_ECHO: [], MODEL: []}
    for name in inputs:
        found[_source(name)].append(name)
    present = {source: names for source, names in found.items() if names}
    return present if set(present) - {FLOW} else {}


def _source(name: str) -> str:
    if name.startswith(parameter_names.LUMEN):
        return LUMEN
    if name.startswith(parameter_names.HEART):
        return CUFF_AND_ECHO
    return MODEL if name in ASSUMED or name.startswith(parameter_names.UNMEASURED) else FLOW
