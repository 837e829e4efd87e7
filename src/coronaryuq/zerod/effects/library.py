"""Library of effects, in the order in which they are reported."""

from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.beds import (
    Autoregulation,
    BackPressure,
    BedCompliance,
    BedResistance,
    CompressedResistance,
    IncompleteHyperaemia,
)
from coronaryuq.zerod.effects.collateral import Collateral, DistalCollateral
from coronaryuq.zerod.effects.drive import DriveGain, DrivePulsatility
from coronaryuq.zerod.effects.exchanged_outlets import ExchangedOutlets
from coronaryuq.zerod.effects.intramyocardial import IntramyocardialDelay, IntramyocardialPressure
from coronaryuq.zerod.effects.kinetic import BifurcationLoss, OstialLoss
from coronaryuq.zerod.effects.leak import DistalLeak, SideBranch, SideBranchLeak
from coronaryuq.zerod.effects.measuring_chain import (
    BeatAveraging,
    CatheterResonance,
    FlowClockRate,
    FlowDelay,
    FlowLowPass,
    PressureClockRate,
    PressureDelay,
    PressureLowPass,
    TriggerDelay,
    WireDrift,
)
from coronaryuq.zerod.effects.misattached_branch import MisattachedBranch
from coronaryuq.zerod.effects.narrowing import DiffuseNarrowing
from coronaryuq.zerod.effects.perfusion import MBFUnderestimation, RotatedTerritories, ShiftedTerritory
from coronaryuq.zerod.effects.probe_places import (
    ExchangedFlows,
    ExchangedPressures,
    FlowCrosstalk,
    MisplacedFlow,
    MisplacedPressure,
)
from coronaryuq.zerod.effects.right_heart import RightHeartWeakness
from coronaryuq.zerod.effects.sensors import (
    FlowDrift,
    FlowGain,
    FlowOffset,
    FlowSaturation,
    PressureDrift,
    PressureGain,
    PressureOffset,
    SharedOffset,
)
from coronaryuq.zerod.effects.stenosis import FocalStenosis, QuadraticStenosis, StenosisWithViscousLoss
from coronaryuq.zerod.effects.storage import EpicardialCompliance, Inertance, ViscoelasticWall
from coronaryuq.zerod.effects.valve import AorticRegurgitation, AorticStenosis, MitralStenosis, PulmonaryStenosis
from coronaryuq.zerod.effects.viscosity import Haematocrit

LIBRARY: tuple[Effect, ...] = (
    QuadraticStenosis(),
    StenosisWithViscousLoss(),
    FocalStenosis(),
    DiffuseNarrowing(),
    Collateral(),
    DistalCollateral(),
    SideBranch(),
    SideBranchLeak(),
    DistalLeak(),
    EpicardialCompliance(),
    ViscoelasticWall(),
    Inertance(),
    IntramyocardialPressure(),
    IntramyocardialDelay(),
    CompressedResistance(),
    BedResistance(),
    BedCompliance(),
    BackPressure(),
    Autoregulation(),
    IncompleteHyperaemia(),
    OstialLoss(),
    BifurcationLoss(),
    Haematocrit(),
    AorticStenosis(),
    AorticRegurgitation(),
    MitralStenosis(),
    PulmonaryStenosis(),
    RightHeartWeakness(),
    MBFUnderestimation(),
    ShiftedTerritory(),
    RotatedTerritories(),
    PressureOffset(),
    SharedOffset(),
    PressureDrift(),
    PressureGain(),
    PressureDelay(),
    PressureClockRate(),
    PressureLowPass(),
    CatheterResonance(),
    MisplacedPressure(),
    ExchangedPressures(),
    FlowOffset(),
    FlowDrift(),
    FlowGain(),
    FlowSaturation(),
    FlowDelay(),
    FlowClockRate(),
    FlowLowPass(),
    MisplacedFlow(),
    ExchangedFlows(),
    FlowCrosstalk(),
    TriggerDelay(),
    BeatAveraging(),
    WireDrift(),
    DriveGain(),
    DrivePulsatility(),
)

WIRING_ERRORS: tuple[Effect, ...] = (ExchangedOutlets(), MisattachedBranch())
"""Wiring errors of the model that the data may reveal: searched like effects, but never named as such."""

SEARCHED = (*LIBRARY, *WIRING_ERRORS)


def effect(name: str) -> Effect:
    """Return the effect or wiring error called `name`; raise KeyError if there is none."""
    return {entry.name: entry for entry in SEARCHED}[name]
