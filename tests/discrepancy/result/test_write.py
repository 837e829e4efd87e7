"""Tables of a result."""

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.vessels_of import vessels_of, vessels_shown


def test_a_place_is_mapped_to_its_vessels():
    anatomy = Anatomy(open_loop().network)
    beds = anatomy.beds
    (one, first), (other, second), *_ = beds.items()
    assert vessels_of(first, anatomy) == vessels_of(one, anatomy) == [first]
    assert vessels_of(f"{first}~{second}", anatomy) == vessels_of(f"{one}<{other}", anatomy)
    assert vessels_of("all beds", anatomy) == list(beds.values())
    assert vessels_of(f"{first}:{one}", anatomy) == vessels_of("every flow", anatomy) == []
    read = f"{first}:{one}"
    for sensor in (read, f"{read} towards {second}", f"{read} with {second}:{other}"):
        assert vessels_shown(sensor, anatomy) == [first]
    assert vessels_shown(f"{read} and {second}:{other}", anatomy) == [first, second]
    assert vessels_shown("every flow", anatomy) == []
