# What every rule uses: the validated configuration, paths, portions, and the source files behind a rule.

import json
import os
import re
import sys
from pathlib import Path

import yaml

from coronaryuq import config as configuration
from coronaryuq.cli import explain
from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.case.description.fields import read_description
from coronaryuq.case.description.dependencies import files_named, lumen
from coronaryuq.core.io.mtime import reset_future_times
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.lock import lock_results

# Jobs started from the shell find this environment's python and mpiexec, whether or not it has been activated.
os.environ["PATH"] = os.pathsep.join([Path(sys.executable).parent.as_posix(), os.environ.get("PATH", "")])


def refuse(error):
    """End with wrong input on one line."""
    print(f"error: {error}", file=sys.stderr, flush=True)
    sys.exit(InputError.EXIT_CODE)


def read_campaign():
    """The configuration named on the command line, validated; the laptop's where none is named.

    With it the files that its case names, and the lumen that is meshed as it is, if one is.
    """
    named = [str(path) for path in workflow.configfiles]
    try:
        if config:
            chosen = configuration.validate(dict(config), ", ".join(named) or "--config")
        else:
            chosen = configuration.load(Path(workflow.basedir, "config", "laptop.yaml"))
        meshed_as_given = chosen.mesh.domain == "lumen"
        if chosen.case == "bundled":
            if meshed_as_given:
                raise InputError(
                    "configuration", "mesh.domain", "lumen", "the bundled patient has centrelines only; choose another"
                )
            return chosen, [], None
        description = read_description(Path(chosen.case))
        own = lumen(chosen.case, description).as_posix() if meshed_as_given else None
        return chosen, files_named(chosen.case, description), own
    except InputError as error:
        refuse(error)


campaign, NAMED, LUMEN = read_campaign()


def results(*parts):
    """Path of a result of this campaign."""
    return Path("results", campaign.name, *parts).as_posix()


def log_of(*parts):
    return results("logs", *parts)


def files_under(path):
    """A file, or all files of a folder: what a rule depends on. One that is missing is left for the rule to name."""
    path = Path(path)
    inside = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path] * path.exists()
    return [p.as_posix() for p in inside]


async def leave_uncached(job):
    """Stands for storing a result where the cache cannot be written."""


onstart:
    # Jobs of their own process read this file too; only the campaign itself takes its folder and says what it is.
    if workflow.is_main_process:
        try:
            workflow.occupied = lock_results(results())
        except InputError as error:
            refuse(error)
        if ahead := reset_future_times(results()):
            print(f"note: {len(ahead)} results were dated later than now: the clock has been set", file=sys.stderr)
        cache = os.environ.get(explain.CACHE)
        if workflow.output_file_cache is not None and not os.access(cache, os.W_OK):
            print(f"note: {cache} cannot be written: results are taken from it, none are added", file=sys.stderr)
            workflow.output_file_cache.store = leave_uncached
        whole = yaml.safe_dump(campaign.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
        write_text(results(explain.CAMPAIGN), whole)


def block(name, without=()):
    """Settings of one stage, as plain values that a changed setting changes and a changed count does not."""
    return getattr(campaign, name).model_dump(mode="json", exclude=set(without))


def script_path(name):
    return Path(workflow.basedir, "workflow", "scripts", name).as_posix()


def code(*modules):
    """Source files behind a rule; as inputs they make its results stale when one of them is edited."""
    return [Path(os.path.relpath(path)).as_posix() for path in provenance.sources(*modules)]


def report_templates(*names):
    return [Path(workflow.basedir, "src", "coronaryuq", "report", name).as_posix() for name in names]


def portions(total, size):
    """Split `total` samples into portions of `size`: {index: (first, count)}; more samples add portions at the end."""
    return {k: (k * size, min(size, total - k * size)) for k in range(-(-total // size))}


def as_json(**values):
    """Parameters of a job that is started from the shell."""
    return json.dumps(values, sort_keys=True)


REALISATIONS = portions(campaign.perfusion.realisations, campaign.samples.chunk_realisations)
# A campaign that grows draws its inputs up to the most that it may run; what it runs of them is found on the way.
GROWS = bool(campaign.estimation.wanted and (campaign.estimation.most_3d or campaign.estimation.most_0d))
COUNTS = {"pilot": campaign.samples.n_3d, "propagation": campaign.samples.n_0d}
if GROWS:
    COUNTS["pilot"] = max(COUNTS["pilot"], campaign.estimation.most_3d or 0)
    COUNTS["propagation"] = max(COUNTS["propagation"], campaign.estimation.most_0d or 0)
BATCHES = portions(COUNTS["pilot"], campaign.samples.batch_3d)
# A coarse level runs the pilot's inputs and goes on in the same table of inputs, where a larger pilot would go on too.
COARSE = campaign.flow3d.coarse
COUNTS["pilot"] *= max(1, COARSE.runs_per_fine)
COARSE_BATCHES = portions(COUNTS["pilot"] if COARSE.runs_per_fine else 0, campaign.samples.batch_3d)
CHUNKS = {name: portions(count, campaign.samples.chunk_0d) for name, count in COUNTS.items()}


wildcard_constraints:
    k=r"\d+",
    level="coarse|fine",
    set="pilot|propagation",
