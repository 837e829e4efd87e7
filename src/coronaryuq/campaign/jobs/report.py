"""Write the report of a campaign."""

from collections.abc import Sequence

from coronaryuq.report.page import write_report as write_page


def write_report(
    figures: Sequence[str], drawings: Sequence[str], answers: Sequence[str], drawn: Sequence[str],
    truths: Sequence[str], costs: Sequence[str], records: Sequence[str], configuration: dict, report: str, **files: str,
) -> None:  # fmt: skip
    """Write the report from result files, figures, searches and the cost of every job."""
    pictures = [*figures, *drawings]
    write_page(files, pictures, costs, configuration, report, (answers, drawn, truths), records)
