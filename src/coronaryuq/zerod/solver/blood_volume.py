"""Blood volume of a closed loop, the only quantity that its equations conserve."""

from collections.abc import Mapping

import numpy as np

from coronaryuq.zerod.network.numbering import INTERNAL, Block, Model
from coronaryuq.zerod.network.parameters import CHAMBERS


class BloodVolume:
    """Stressed volume (mL) of a closed loop, as a function of its state and of changed parameters.

    Every compliance stores C times the pressure that its element's equations differentiate; chambers and
    intramyocardial compartments store their volume. The sum is constant in time. The pulmonary compliance is not part
    of it, because svZeroDSolver fills the left atrium with the flow out of the right ventricle.
    """

    def __init__(self, model: Model):
        self.model = model

    def evaluate(self, state: np.ndarray, changes: Mapping[str, np.ndarray | float] | None = None) -> np.ndarray:
        """Return the volume (n,) of states (n, unknowns) with `"BLOCK.parameter"` changes (n,) or scalar.

        Changed waveforms (n, points) store no blood.
        """
        changes = {name: value for name, value in (changes or {}).items() if np.ndim(value) < 2}
        total = np.zeros(len(state))
        for block in self.model.blocks.values():
            holds = _HOLDS.get(block.kind)
            rigid = block.scalars.get("C") == 0.0 and f"{block.name}.C" not in changes
            if holds is not None and not rigid:
                total = total + holds(block, state, _Parameters(block, changes))
        return total

    def with_blood_added(self, state: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """Return states (n, unknowns) of a loop with a heart, with `volume` (n,) mL more blood in the right atrium."""
        heart = next(b for b in self.model.blocks.values() if b.kind == "ClosedLoopHeartAndPulmonary")
        names = INTERNAL[heart.kind]
        state = state.copy()
        state[:, heart.variables[len(heart.variables) - len(names) + names.index("V_RA")]] += volume
        return state


class _Parameters:
    """A block's parameters with the changes in place."""

    def __init__(self, block: Block, changes: Mapping):
        self.block, self.changes = block, changes

    def __getitem__(self, name: str):
        value = self.changes.get(f"{self.block.name}.{name}", self.block.scalars[name])
        return np.asarray(value, float)


def _behind(block: Block, state: np.ndarray, resistance) -> np.ndarray:
    """Return the pressure behind a resistance at the block's inlet."""
    flow = block.inlets[0]
    return state[:, flow + 1] - resistance * state[:, flow]


def _vessel(block, state, parameter):
    flow, out = state[:, block.inlets[0]], state[:, block.outlets[0]]
    resistance = parameter["R_poiseuille"] + parameter["stenosis_coefficient"] * np.abs(flow)
    return parameter["C"] * (_behind(block, state, resistance) - parameter["R_wall"] * (flow - out))


def _vessel_crl(block, state, parameter):
    return parameter["C"] * _behind(block, state, 0.0)


def _coronary(block, state, parameter):
    return parameter["Ca"] * _behind(block, state, parameter["Ra"]) + state[:, block.variables[-1]]


def _rcr(block, state, parameter):
    return parameter["C"] * state[:, block.variables[-1]]


def _heart(block, state, parameter):
    names = INTERNAL["ClosedLoopHeartAndPulmonary"]
    inside = dict(zip(names, block.variables[-len(names) :], strict=True))
    chambers = sum(state[:, inside[name]] for name in ("V_RA", "V_RV", "V_LA", "V_LV"))
    aorta = state[:, block.outlets[0] + 1]
    return chambers + parameter["Cpa"] * aorta


def _chamber(block, state, parameter):
    return state[:, block.variables[-1]]


_HOLDS = {
    **dict.fromkeys(CHAMBERS, _chamber),
    "BloodVessel": _vessel,
    "BloodVesselCRL": _vessel_crl,
    "ClosedLoopCoronaryLeft": _coronary,
    "ClosedLoopCoronaryRight": _coronary,
    "ClosedLoopRCR": _rcr,
    "ClosedLoopHeartAndPulmonary": _heart,
}
