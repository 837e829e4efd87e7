"""The vessels of the place of an effect."""

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.beds import ALL


def vessels_of(place: str, anatomy: Anatomy) -> list[str]:
    """Return the vessels of a place, or of its beds: two for a collateral, none for a sensor."""
    if place == ALL:
        return list(anatomy.beds.values())
    parts = [part for end in place.split("~") for part in end.split("<")]
    return [anatomy.beds.get(part, part) for part in parts if part in anatomy.beds or part in anatomy.vessels]
