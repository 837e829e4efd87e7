"""Draw one figure from result files."""

from coronaryuq.figures.draw import draw


def draw_figure(name: str, figure: str, drawing: str | None = None, **inputs: str) -> None:
    """Draw the figure `name` from its named input files, as PNG and, if its rule has a `drawing`, as SVG."""
    draw(name, inputs, [figure, drawing] if drawing else figure)
