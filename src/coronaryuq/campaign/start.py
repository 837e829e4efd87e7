"""Start of a campaign: read its configuration, and lock its results folder before the first job."""

import json
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from coronaryuq import config
from coronaryuq.campaign import explain
from coronaryuq.case.description.dependencies import check_files, files_named, lumen, measurements
from coronaryuq.case.description.fields import read_description
from coronaryuq.case.description.yaml_file import as_written
from coronaryuq.config import Campaign
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.lock import lock_results
from coronaryuq.core.io.mtime import reset_future_times
from coronaryuq.core.private_folders import takes_files

_taken: list[AbstractContextManager] = []
"""Lock of the results folder, kept until this process ends."""


@dataclass(frozen=True)
class Given:
    """A campaign's configuration, the files of its case, its lumen if that is meshed directly, and its measurements.

    measurements: the table and the file of conditions. in_3d: whether the case has a 3D model. map_condition: condition
    under which their perfusion is read from the case's map.
    """

    campaign: Campaign
    named: list[Path]
    lumen: str | None
    measurements: tuple[str, str] | None
    in_3d: bool
    map_condition: str | None = None


def read_campaign(settings: dict[str, Any], configfiles: Sequence[str], default: Path) -> Given:
    """Read and check a configuration and its case.

    Parameters
    ----------
    settings
        The configuration as Snakemake merged it; if empty, the file `default` is read.
    configfiles
        Files from which it was read, for error messages.

    Raises
    ------
    InputError
        If anything is wrong with it.
    """
    if settings:
        values: dict[str, Any] = dict(settings)
        # Snakemake takes the last of two keys, and guesses what is a number.
        for path in filter(os.path.isfile, configfiles):
            values = as_written(values, path, config.EXPECTED)
        campaign = config.validate(values, ", ".join(map(str, configfiles)) or "--config")
    else:
        campaign = config.load(default)
    meshed_as_it_is = campaign.mesh.domain == "lumen"
    if campaign.case == "bundled":
        if meshed_as_it_is:
            remedy = "the bundled patient has centrelines only; choose another domain"
            raise InputError("configuration", "mesh.domain", "lumen", remedy)
        return Given(campaign, [], None, None, True)
    description = read_description(Path(campaign.case))
    surface = lumen(campaign.case, description).as_posix() if meshed_as_it_is else None
    measured = measurements(campaign.case, description)
    in_3d = description.anatomy is not None and description.stenoses != []
    check_files(campaign.case, description)
    # Measurements of the configuration replace those of the case.
    own = description.measurements if campaign.discrepancy.measurements is None else None
    map_condition = None if own is None else own.map_condition
    return Given(campaign, files_named(campaign.case, description), surface, measured, in_3d, map_condition)


def check_place(snakefile: str) -> None:
    """Raise `InputError` if the workflow lies in a folder whose name Snakemake takes for a pattern."""
    folder = Path(snakefile).absolute().parent
    if {"{", "}"} & set(folder.as_posix()):
        raise InputError(folder, None, None, "Snakemake takes braces for wildcards; rename the folder")


def announce(campaign: Campaign, snakefile: str) -> None:
    """Pass the path of the Snakefile and the whole configuration, which the first job writes to a file, to all jobs.

    Environment variables work everywhere: on a cluster every job reads the workflow, and calls this, again. A hook of
    the workflow would not suffice, because Snakemake does not run the hooks of a module.
    """
    os.environ[shipped.VARIABLE] = os.path.abspath(snakefile)
    whole = yaml.safe_dump(campaign.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
    known = json.loads(os.environ.get(explain.CONFIGURATIONS, "{}"))
    os.environ[explain.CONFIGURATIONS] = json.dumps(known | {campaign.name: whole})


def take_folder(folder: str) -> None:
    """Lock the results folder for this process, and repair times in the future.

    Raises
    ------
    InputError
        If another campaign is running in the folder.
    """
    _taken.append(lock_results(folder))
    if future := reset_future_times(folder):
        print(f"note: {len(future)} results have modification times in the future; reset to now", file=sys.stderr)
    if not cache_is_writable():
        print(f"note: {os.environ[explain.CACHE]} cannot be written: no cache is used", file=sys.stderr)


def cache_is_writable() -> bool:
    """Return whether the cache between campaigns can be written; one that cannot is not used."""
    cache = os.environ.get(explain.CACHE)
    return not cache or takes_files(cache)


def refuse(error: InputError) -> NoReturn:
    """Print wrong input on one line and exit."""
    print(f"error: {error}", file=sys.stderr, flush=True)
    sys.exit(InputError.EXIT_CODE)
