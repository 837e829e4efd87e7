"""Draw one figure from result files."""

from coronaryuq.figures.draw import draw


def draw_figure(name: str, figure: str, **inputs: str) -> None:
    """Draw the figure `name` from its named input files."""
    draw(name, inputs, figure)
