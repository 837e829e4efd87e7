"""Wiring errors of a network, whose blocks are connected otherwise than the patient's vessels."""

from abc import abstractmethod

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.base import Effect


class WiringError(Effect):
    """Base class of wiring errors of the model, which are searched like effects and never named."""

    nameable = False

    @abstractmethod
    def statement(self, place: str) -> str:
        """Return what is wrong, as part of a sentence."""

    @abstractmethod
    def corrected(self, network: Network, place: str) -> tuple[Network, dict[str, str]]:
        """Return the network as it should have been connected, and old → new names of locations."""
