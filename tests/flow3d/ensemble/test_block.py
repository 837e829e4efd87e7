"""How often a block samples the wall."""

from coronaryuq.flow3d.ensemble.block import stride_of


def test_the_stride_between_wall_samples_divides_the_cycle():
    assert stride_of(800, 200) == 4
    assert stride_of(1000, 300) == 2
    assert stride_of(210, 200) == 1
