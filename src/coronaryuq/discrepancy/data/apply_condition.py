"""The network under a condition: changed values, drives and period."""

from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError, similar
from coronaryuq.discrepancy.data.conditions import COVARIATES, Condition
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.beds import arteriolar
from coronaryuq.zerod.network.differences import ELEMENTS, LOSS, is_number
from coronaryuq.zerod.network.period import period_of, set_period
from coronaryuq.zerod.network.waveforms import WAVEFORMS, without_noise

LARGEST_DRIVE = {"PRESSURE": 6.0, "FLOW": 12.0}
"""Largest mean of a drive over the network's own: kPa and mmHg differ by 7.5, L/min and mL/s by 17."""
LONGEST_DRIVE = 10.0
"""Longest beat of a drive over the network's own, and the reverse; s and ms differ by 1,000."""
SAME_BEAT = 0.02
"""Relative tolerance of the length of a drive."""


def apply_condition(network: Network, condition: Condition, file: str | Path = "conditions") -> Network:
    """Return the network under a condition.

    Parameters
    ----------
    network
        svZeroDSolver network.
    condition
        Condition to apply: resistance of the arterioles, `scale` and `set`, drives, then the period. Copies of a
        boundary condition follow it, unless the condition names them, too.
    file
        Conditions file named in error messages.

    Raises
    ------
    InputError
        If the condition names blocks, parameters or waveforms that are not in the network.
    """
    network = network.deep_copy()
    anatomy, period = Anatomy(network), period_of(network)
    factor = condition.coronary_resistance_scale
    for bed in anatomy.dilating:
        anatomy.blocks[bed]["bc_values"].update({k: v * factor for k, v in arteriolar(network, bed).items()})
    _change_values(network, anatomy, condition, file)
    _check_stenoses(anatomy, condition, file)
    target = _drive(anatomy, condition, period, file)
    set_period(network, target)
    return network


def _change_values(network: Network, anatomy: Anatomy, condition: Condition, file: str | Path) -> None:
    """Apply `scale` and `set`."""
    for key, table in (("scale", condition.scale), ("set", condition.set)):
        for block, entry in table.items():
            values = _values(network, block)
            if values is None:
                near = similar(block, [*anatomy.vessels, *anatomy.blocks])
                remedy = f"no such block in the network{near and f'; {near}'}"
                raise InputError(file, f"{condition.name}.{key}.{block}", None, remedy)
            for parameter, value in entry.items():
                # If an effect has replaced CORONARY by CORONARY_VAR_RES, one Ra2 has become two.
                split = [f"{parameter}_min", f"{parameter}_max"]
                for name in split if parameter not in values and all(one in values for one in split) else [parameter]:
                    if name in ELEMENTS and block in anatomy.vessels:
                        values.setdefault(name, 0.0)
                    if name not in values or not is_number(values[name]):
                        known = ", ".join(k for k, v in values.items() if is_number(v))
                        raise InputError(file, f"{condition.name}.{key}.{block}.{name}", None, f"known: {known}")
                    old, values[name] = values[name], values[name] * value if key == "scale" else value
                    for copy in (copy for copy in network.copies.get(block, []) if copy not in table):
                        own = network.bed_values(copy)
                        own[name] = own[name] * values[name] / old if old else values[name]


def _check_stenoses(anatomy: Anatomy, condition: Condition, file: str | Path) -> None:
    for vessel, name in condition.stenosis.items():
        where = f"{condition.name}.stenosis.{vessel}"
        if vessel not in anatomy.vessels:
            raise InputError(file, where, name, f"no such vessel in the network; known: {', '.join(anatomy.vessels)}")
        values = anatomy.vessels[vessel]["zero_d_element_values"]
        if values.get("C", 0.0) > 0.0:
            raise InputError(file, where, name, "the vessel has a C; add a vessel without C ahead of it for the loss")
        if not values.get(LOSS, 0.0) > 0.0:
            raise InputError(file, where, name, f"set {vessel}'s {LOSS} to an estimate under this condition")


def _drive(anatomy: Anatomy, condition: Condition, period: float, file: str | Path) -> float:
    """Apply the drives and return the condition's period (s)."""
    for name in COVARIATES:
        if name in condition.drive and name in {*anatomy.vessels, *anatomy.blocks}:
            remedy = "both the left ventricular pressure of a drive and a block of the network; rename that block"
            raise InputError(file, f"{condition.name}.drive.{name}", None, remedy)
    target = _own_period(condition, period, file)
    for name, (time, value) in condition.drive.items():
        if name in COVARIATES:
            continue
        block = anatomy.blocks.get(name)
        if block is None or block["bc_type"] not in WAVEFORMS:
            known = ", ".join([b for b, v in anatomy.blocks.items() if v["bc_type"] in WAVEFORMS] + list(COVARIATES))
            raise InputError(file, f"{condition.name}.drive.{name}", None, f"no block with a waveform; known: {known}")
        kind, most = block["bc_type"], LARGEST_DRIVE.get(block["bc_type"], np.inf)
        own, given = (float(np.abs(np.mean(each))) for each in (block["bc_values"][WAVEFORMS[kind]], value))
        if own > 0.0 and not 1.0 / most <= given / own <= most:
            where = f"{condition.name}.drive.{name}: mean over the network's own"
            raise InputError(file, where, float(f"{given / own:.3g}"), f"use the network's unit of {kind.lower()}")
        time, value = without_noise(time, value)
        copies = (copy for copy in anatomy.network.copies.get(name, []) if copy not in condition.drive)
        for each in (name, *copies):
            anatomy.blocks[each]["bc_values"] |= {"t": time.tolist(), WAVEFORMS[kind]: value.tolist()}
    return target


def _own_period(condition: Condition, period: float, file: str | Path) -> float:
    """Return the condition's period (s): that of its drives, unless a `period_scale` is given.

    In that case drives may last as long as the beat of the condition or that of the network, `period`, and are
    rescaled. Covariates do not set the period; they have to agree with it.
    """
    target = period * condition.period_scale
    lengths = {name: float(waveform[0][-1]) for name, waveform in condition.drive.items()}
    driving = [length for name, length in lengths.items() if name not in COVARIATES]
    if condition.period_scale == 1.0 and driving:
        target = driving[0]
    for name, length in lengths.items():
        where = f"{condition.name}.drive.{name}: length (s)"
        if not 1.0 / LONGEST_DRIVE <= length / period <= LONGEST_DRIVE:
            raise InputError(file, where, length, f"the network's beat lasts {period:.4g}; give t in s, over one beat")
        if condition.period_scale == 1.0:
            allowed = SAME_BEAT if name in COVARIATES else 1e-9
            if abs(length - target) > allowed * target:
                remedy = f"expected {target:.4g}" + (", like the other drives" if driving else "")
                raise InputError(file, where, length, remedy)
        elif min(abs(length - beat) / beat for beat in (period, target)) > SAME_BEAT:
            remedy = f"with a period_scale, expected the network's beat ({period:.4g}) or that of the condition "
            remedy += f"({target:.4g})"
            raise InputError(file, where, length, remedy)
    return target


def _values(network: Network, block: str) -> dict | None:
    parts = ("vessels", "boundary_conditions", "closed_loop_blocks")
    return next((one.values for one in network.elements() if one.name == block and one.part in parts), None)
