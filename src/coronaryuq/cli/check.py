"""`coronaryuq check FILE`: read a case or a configuration and all files that it refers to, as a campaign does."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from coronaryuq.adoption.map_errors import readings_of_map
from coronaryuq.campaign import start
from coronaryuq.campaign.paths import Paths
from coronaryuq.campaign.searches import Searches
from coronaryuq.campaign.targets import Targets
from coronaryuq.case.assembly import AssembledCase, assemble
from coronaryuq.case.check import describe
from coronaryuq.case.description.dependencies import measurements
from coronaryuq.case.description.fields import Description
from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.case.settings import Settings
from coronaryuq.case.sketch import Sketch
from coronaryuq.config import EXPECTED, Campaign
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_file
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.measurements import measured_conditions
from coronaryuq.discrepancy.inference.read_problem import read_series
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.zerod.effects.pullback import CHECK
from coronaryuq.zerod.network.read import check_network

NEITHER = (
    "neither a case nor a configuration: expected a mapping of fields; see docs/reference/case.md and config/README.md"
)


@dataclass
class Checked:
    """Contents of a file up to the first error.

    Attributes
    ----------
    file
        The file.
    kind
        Whether it is a case or a configuration.
    error
        The first error, or None.
    lines
        Description of the contents, in words.
    case
        The case in the file or of the configuration; None for the bundled patient and if it has an error.
    campaign
        The configuration, None for a case.
    sketch
        What was understood of the case's vessels, also if there is an error behind them.
    """

    file: Path
    kind: Literal["case", "configuration"]
    error: InputError | None = None
    lines: list[str] = field(default_factory=list)
    case: AssembledCase | None = None
    campaign: Campaign | None = None
    sketch: Sketch = field(default_factory=Sketch)

    def as_json(self) -> dict[str, Any]:
        """Return it as `coronaryuq check --json` prints it (docs/reference/formats.md)."""
        error = self.error and {name: getattr(self.error, name) for name in ("file", "field", "value", "remedy")}
        return {
            "file": self.file.as_posix(),
            "kind": self.kind,
            "sound": self.error is None,
            "error": error and error | {"value": None if error["value"] is None else str(error["value"])},
            "lines": self.lines,
            "case": self.case and self.case.summary.model_dump(mode="json"),
            "configuration": self.campaign and self.campaign.model_dump(mode="json"),
        }


def check(path: str | Path) -> Checked:
    """Read a case or a configuration, and every file that it refers to, up to the first error.

    Raises
    ------
    InputError
        If the file is not a YAML mapping, so that it is neither.
    """
    values = read_yaml(path, NEITHER)
    found = Checked(Path(path), kind_of(values))
    try:
        if found.kind == "case":
            _check_case(found, path, Settings())
        else:
            _check_configuration(found, values)
    except InputError as error:
        found.error = error
    return found


def kind_of(values: dict[str, Any]) -> Literal["case", "configuration"]:
    """Return whether the keys of a file are those of a case or of a configuration, misspelt ones included."""
    case, campaign = set(Description.model_fields), set(Campaign.model_fields)
    of_case, of_campaign = (
        sum(bool(get_close_matches(key, own, n=1, cutoff=0.8)) for key in values)
        for own in (case - campaign, campaign - case)
    )
    # The blocks `name` and `perfusion` are valid in both; a case needs more than these, a configuration does not.
    return "case" if of_case > of_campaign else "configuration"


def _check_case(found: Checked, path: str | Path, settings: Settings) -> None:
    found.sketch.file = Path(path)
    try:
        found.case = assemble(path, settings, sketch=found.sketch)
    finally:
        found.lines += found.sketch.lines()
    own = found.case.description.network
    check_network(found.case.network, path if own is None else Path(path).parent / own)
    found.lines += describe(found.case)
    if named := measurements(path, found.case.description):
        table, file = named
        conditions = read_conditions(file)
        series = read_series(found.case.network, table, conditions, file)
        given = found.case.description.measurements
        if given is not None and given.map_condition is not None:
            readings_of_map(series, given.map_condition, [outlet.bc for outlet in found.case.summary.lv_outlets], path)
        states = [f"{name} (held out)" if conditions[name].held_out else name for name in measured_conditions(series)]
        found.lines.append(f"measurements: {len(series)} series under {', '.join(states)}")
        found.lines += [
            f"pullback: {one.value.size} readings along {' > '.join(one.pullback.path)} ({one.pullback.length:.3g} cm) "
            f"under {one.condition}"
            for one in series
            if one.pullback is not None and one.quantity != CHECK
        ]


def _length(posterior: PosteriorSettings) -> str:
    if posterior.independence.use and posterior.emulator.use and posterior.constraint == "conditioned":
        return f"{posterior.independence.draws} independence steps"
    return f"{posterior.dream.generations} generations"


def _check_configuration(found: Checked, values: dict[str, Any]) -> None:
    if not values:
        raise InputError(found.file, None, None, EXPECTED)
    given = start.read_campaign(values, [str(found.file)], found.file)
    found.campaign = campaign = given.campaign
    targets, paths = Targets(campaign), Paths(campaign.name)
    found.lines += [
        f"{found.file}: the configuration of a campaign, whose results are in {paths.results()}",
        f"3D: {targets.most['n_3d']} runs by {campaign.backend} in {len(targets.batches)} jobs"
        + (f", {targets.coarse_runs} coarse runs for each" if targets.coarse_runs else ""),
        f"0D: {targets.most['n_0d']} runs per input set by {campaign.zerod.backend} in "
        f"{len(targets.chunks['propagation'])} jobs",
        f"posterior: {campaign.posterior.dream.chains} chains of {_length(campaign.posterior)}",
    ]
    changed = [f"{name}: {value}" for name, value in _changed(campaign) if name != "name"]
    found.lines.append(f"settings other than the defaults: {', '.join(changed) or 'none'}")
    tuned, bundled = paths.results("calibration", "rest.json"), campaign.case == "bundled"
    searches = Searches(campaign.discrepancy, paths, tuned, bundled, given.measurements)
    searches.check()
    if campaign.discrepancy.in_report and not searches.names:
        found.lines.append("note: discrepancy.in_report has no effect without measurements of this patient")
    if campaign.paper_data and not Path(campaign.paper_data).is_dir():
        found.lines.append(f"note: paper_data = {campaign.paper_data} is not there; only the targets paper_* need it")
    if bundled:
        found.lines.append("case: the bundled patient")
    else:
        found.lines.append(f"case: {campaign.case}")
        _check_case(found, campaign.case, campaign.patient)


def _changed(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the settings that differ from their defaults, by name."""
    for name, described in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _changed(value, f"{prefix}{name}.")
        elif value != described.get_default(call_default_factory=True):
            yield f"{prefix}{name}", value


def draw_check(found: Checked, picture: str | None) -> list[str]:
    """Draw the vessels of what was checked, as far as they were read, and return a line that names each file.

    Where a perfusion map was registered, a second picture shows it on the scan.

    Parameters
    ----------
    found
        The checked file.
    picture
        PNG or SVG; None: beside the case, unless its folder cannot be written.

    Raises
    ------
    InputError
        If `picture` has another format or cannot be written.
    """
    sketch = found.sketch
    if sketch.tree is None or sketch.file is None:
        return []
    output = Path(picture) if picture else sketch.file.with_suffix(".check.png")
    if output.suffix.lower() not in (".png", ".svg"):
        raise InputError("command line", "--picture", str(output), "name a file that ends in .png or .svg")
    from coronaryuq.figures.case_picture import case_picture
    from coronaryuq.figures.registration_picture import registration_picture

    drawn = [output]
    try:
        check_file(output)
        case_picture(sketch, output)
        if sketch.scan is not None and sketch.wall is not None:
            drawn.append(output.with_name(f"{output.name.removesuffix(output.suffix)}.registration{output.suffix}"))
            registration_picture(*sketch.scan, sketch.wall, drawn[-1])
    except (InputError, OSError):
        if picture:
            raise
        return [f"picture: none, because {output.parent} cannot be written; name a file with --picture"]
    return [f"picture: {path}" for path in drawn]
