"""A network with adopted effects: their elements, the first member of each class in its values, sizes uncertain.

The values hold with the first member at the mean of its sizes. What an effect sets in vessels, in the heart and in
added elements is held in calibration (`Network.held`), the heart's from the loop that was searched. What it changes in
beds is tuned anyway, to the patient's targets and with the other effects present: there the effect adds its spread.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coronaryuq.adoption.choice import Placed
from coronaryuq.case.network.network import HEART, UNCERTAIN, Network
from coronaryuq.zerod.effect_mixture import EffectMixture, Member
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.grafting import with_elements
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.changes import with_changes

NAME = "missing_{}"
"""Name of the uncertain parameter of a class."""


@dataclass(frozen=True)
class Adopted:
    """A network with effects, and the reason why a member does not act in it, by its label; empty if all act."""

    network: Network
    refused: dict[str, str]


def with_effects(
    network: Network, searched: Network, classes: Sequence[Sequence[Placed]], scales: Mapping[str, Any],
    named: Iterable[str] = (), source: str = "",
) -> Adopted:  # fmt: skip
    """Return the network with classes of effects.

    Parameters
    ----------
    network
        Network to be tuned, CGS.
    searched
        The loop that was searched: where the heart's values without the effects are from.
    classes
        Members of each class.
    scales
        Pressure, period and flows that sizes refer to.
    named
        0D locations that the campaign reads, which no effect may rename.
    source
        Where the effects are from, for the file.
    """
    mixtures, refused = [], {}
    for number, members in enumerate(classes, start=1):
        held = []
        for one in members:
            reason = _obstacle(network, one, scales, set(named))
            if reason:
                refused[one.label] = reason
            shape = tuple(one.mean), tuple(map(tuple, one.covariance))
            held.append(Member(one.effect, one.place, one.probability, not reason, *shape, {}))
        label = " or ".join(one.label for one in members)
        mixtures.append(EffectMixture(NAME.format(number), tuple(held), scales, label, source))
    return Adopted(with_mixtures(network, searched, mixtures), refused)


def with_mixtures(network: Network, searched: Network, mixtures: Iterable[EffectMixture]) -> Network:
    """Return a network with the elements, values and entries of mixtures of which a member acts."""
    acting = [one for one in mixtures if any(member.acts for member in one.members)]
    tuned = {block["bc_name"] for block in network.boundary_conditions}
    placed = [(member.law, member.place) for mixture in acting for member in mixture.members if member.acts]
    plain, renamed = with_elements(network, placed, lambda found: _anatomy(found, acting[0].scales))
    hearts = {f"{HEART}.{name}": value for name, value in _heart(searched).items()}
    pairs = [(one, member) for one in acting for member in one.members if member.acts]
    touched = {target for one, member in pairs for target in _at_mean(plain, one, member)}
    plain = with_changes(plain, {target: hearts[target] for target in touched if target in hearts})
    own, entries = _scalars(plain), []
    values: dict[str, float] = {}
    for mixture in acting:
        members = []
        for member in mixture.members:
            targets = _at_mean(plain, mixture, member) if member.acts else {}
            held = {name: own.get(name, 0.0) for name in targets if name.rpartition(".")[0] not in tuned}
            members.append(replace(member, absent=held))
            if member is mixture.members[0]:
                for name in held:
                    values[name] = values.get(name, own.get(name, 0.0)) + targets[name] - own.get(name, 0.0)
        entries.append(replace(mixture, members=tuple(members), renamed=renamed).content())
    found = with_changes(plain, values)
    if entries:
        found[UNCERTAIN] = [*found.get(UNCERTAIN, []), *entries]
    return found


def _obstacle(network: Network, one: Placed, scales: Mapping[str, Any], named: set[str]) -> str:
    """Return why a member cannot act in the network, or an empty text."""
    law = effect(one.effect)
    if one.measurement:
        return "an error of a sensor: the measurements are corrected, not the model"
    if not law.nameable:
        return "an error of the model's wiring, which is to be mended in the case"
    if law.feedback:
        return "its resistances follow the pressures of each run, which samples cannot carry"
    anatomy = _anatomy(network, scales)
    renamed = sorted(named & set(law.aliases(one.place, anatomy))) if law.inserts(one.place, anatomy) else []
    if renamed:
        return f"its elements would stand at {renamed[0]}, where the case reads pressure or flow"
    with_elements = law.insert(network, one.place, anatomy)
    if len(Anatomy(with_elements).beds) > len(anatomy.beds):
        return "its bed would be an outlet that the case does not have: add the branch to the case's anatomy"
    mixture = EffectMixture("", (), scales)
    member = Member(one.effect, one.place, 1.0, True, tuple(one.mean), tuple(map(tuple, one.covariance)), {})
    values = _changes(with_elements, mixture, member)
    if not values:
        return "it acts in hyperaemia alone, which is a condition of the case"
    if any(np.ndim(value) > 1 for value in values.values()):
        return "it changes a waveform, which samples cannot carry"
    return ""


def _at_mean(network: Network, mixture: EffectMixture, member: Member) -> dict[str, float]:
    return {name: float(np.ravel(value)[0]) for name, value in _changes(network, mixture, member).items()}


def _changes(network: Network, mixture: EffectMixture, member: Member) -> dict[str, np.ndarray]:
    anatomy = _anatomy(network, mixture.scales)
    state = ConditionState(1.0, anatomy.period, {}, {}, {})
    return member.law.changes(network, member.place, member.sizes(np.zeros((1, len(member.mean)))), anatomy, state)


def _anatomy(network: Network, scales: Mapping[str, Any]) -> Anatomy:
    return Anatomy(network, scales["pressure"], dict(scales["flow"]), scales["period"])


def _heart(network: Network) -> dict[str, float]:
    return dict(network.heart["parameters"]) if network.closed_loop else {}


def _scalars(network: Network) -> dict[str, float]:
    return {
        f"{element.name}.{name}": float(value)
        for element in network.elements()
        for name, value in element.values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
