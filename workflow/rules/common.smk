# What the rules use: the checked configuration, its jobs and paths, and functions that ask other rules. No rules here.

import json
import os
import re
import shlex
import sys
from pathlib import Path

from coronaryuq.campaign import drawings, index, start, variants
from coronaryuq.campaign.paths import Paths, files_under
from coronaryuq.campaign.searches import Searches
from coronaryuq.campaign.targets import Targets
from coronaryuq.core import provenance, shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.figures.draw import module_of


# The software of every job; built as envs/coronaryuq.def says, used with --software-deployment-method apptainer.
container: "envs/coronaryuq.sif"


# Jobs find this environment's python and mpiexec whether or not it is activated.
shell.prefix(f'set -euo pipefail; export PATH={shlex.quote(Path(sys.executable).parent.as_posix())}:"$PATH"; ')


try:
    given = start.read_campaign(config, workflow.configfiles, shipped.configuration("laptop"))
    campaign, paths = given.campaign, Paths(given.campaign.name)
    results, log_of, cost_of = paths.results, paths.log, paths.cost
    targets = Targets(campaign)
    searches = Searches(campaign.discrepancy, paths, tuned=results("calibration", "rest.json"))
    searches.check()
    start.announce(campaign, workflow.main_snakefile)
except InputError as error:
    start.refuse(error)

figures, paper_figures = drawings.figures(campaign, paths), drawings.paper_figures(paths)
meshes, runs_3d = variants.meshes(campaign), variants.runs_3d(targets)
cached = start.cache_is_writable()


onstart:
    try:
        start.take_folder(results())
    except InputError as error:
        start.refuse(error)


onsuccess:
    index.describe_results(results())


onerror:
    index.describe_results(results())


wildcard_constraints:
    k=r"\d+",
    set="pilot|propagation",
    mesh="|".join(meshes),
    run="|".join(runs_3d),


def stage(function, *modules):
    """Parameters of a job: its function, as MODULE:FUNCTION, and the digest of the code behind it and other modules."""
    behind = (function.partition(":")[0], *modules)
    return {"function": function, "code": lambda wildcards: provenance.code_digest(*behind)}


def drawing(name):
    """Parameters of a job that draws the figure that `name` gives for its wildcards."""
    function = "coronaryuq.campaign.jobs.figure:draw_figure"
    return {
        "function": function,
        "code": lambda wildcards: provenance.code_digest("coronaryuq.figures.draw", module_of(name(wildcards))),
        "name": name,
    }


def block(name, without=()):
    """Settings of one stage, without counts whose change leaves what has been computed valid."""
    return getattr(campaign, name).model_dump(mode="json", exclude=set(without))


def as_json(job, **values):
    """Parameters of a job that is started from the shell."""
    return json.dumps(job | {"code": job["code"](None)} | values, sort_keys=True)


def alternatives(names):
    """Constraint of a wildcard to some names; a rule without any makes nothing."""
    return "|".join(map(re.escape, names)) or "none"


def mesh_of(wildcards):
    """The mesh that 3D runs need."""
    folder = runs_3d[wildcards.run].mesh
    return {"mesh_dir": results(folder, "mesh-complete"), "mesh_json": results(folder, "mesh.json")}


def decision(number):
    """What round `number` of a growing campaign decided; Snakemake runs the round first."""
    return read_json(checkpoints.allocation.get(r=number).output.round_json)


def last_round():
    """The round after which a growing campaign stops."""
    return next(number for number in range(campaign.estimation.rounds) if decision(number)["done"])


def counts_of_campaign():
    """3D and 0D runs of the campaign."""
    return decision(last_round())["counts"] if targets.grows else targets.first_counts


def runs_of(counts):
    """Files of the first `counts` runs."""
    ks = targets.needed(counts)
    return {
        "records": expand(results("flow3d", "batch_{k}.jsonl"), k=ks["flow3d"]),
        "coarse": expand(results("coarse", "batch_{k}.jsonl"), k=ks["coarse"]),
        "zerod_pilot": expand(results("zerod", "pilot_{k}.parquet"), k=ks["zerod_pilot"]),
        "zerod_propagation": expand(results("zerod", "propagation_{k}.parquet"), k=ks["zerod_propagation"]),
    }


def runs_of_round(wildcards):
    """Files of the runs that a round of a growing campaign looks at, and the decision that asked for them."""
    number = int(wildcards.r)
    if number == 0:
        return runs_of(targets.first_counts)
    return runs_of(decision(number - 1)["next"]) | {"before": results("allocation", f"round_{number - 1}.json")}


def end_of_growth(wildcards):
    """Last decision of a growing campaign, by name."""
    return {"allocation": results("allocation", f"round_{last_round()}.json")} if targets.grows else {}


def runs_of_campaign(wildcards):
    """Files of all runs of the campaign."""
    return runs_of(counts_of_campaign()) | end_of_growth(wildcards)


def costs_of_campaign(wildcards):
    """Costs of the jobs that computed what the report quotes."""
    ks = targets.needed(counts_of_campaign())
    stages = ("case", "perfusion", "calibration", "posterior_chains", "posterior", "mesh/mesh", "runs")
    return [
        *(cost_of(f"{name}.json") for name in (*stages, "estimation_train", "estimation")),
        *expand(cost_of("perfusion_chunk_{k}.json"), k=targets.realisations),
        *expand(cost_of("flow3d/batch_{k}.json"), k=ks["flow3d"]),
        *expand(
            cost_of("coarse/{job}.json"), job=[*["mesh"] * bool(ks["coarse"]), *(f"batch_{k}" for k in ks["coarse"])]
        ),
        *expand(cost_of("zerod/pilot_{k}.json"), k=ks["zerod_pilot"]),
        *expand(cost_of("zerod/propagation_{k}.json"), k=ks["zerod_propagation"]),
        *expand(cost_of("zerod/resampled_{k}.json"), k=targets.shares),
        *expand(
            cost_of("discrepancy_search_{case}.json"), case=searches.cases if campaign.discrepancy.in_report else []
        ),
    ]
