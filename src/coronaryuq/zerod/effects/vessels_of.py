"""The vessels of the place of an effect."""

import re

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.beds import ALL
from coronaryuq.zerod.effects.probe_places import AND, TOWARDS, WITH


def vessels_of(place: str, anatomy: Anatomy) -> list[str]:
    """Return the vessels of a place, or of its beds: two for a collateral, none for a sensor."""
    if place == ALL:
        return list(anatomy.beds.values())
    parts = [part for end in place.split("~") for part in end.split("<")]
    return [anatomy.beds.get(part, part) for part in parts if part in anatomy.beds or part in anatomy.vessels]


def vessels_shown(place: str, anatomy: Anatomy) -> list[str]:
    """Return the vessels on which a picture shows a place: those of the place or, of a sensor, those it should read."""
    should = re.split(f"{TOWARDS}|{WITH}", place)[0].split(AND)
    read = (anatomy.vessel_at(location) for location in should)
    return vessels_of(place, anatomy) or [vessel for vessel in read if vessel]
