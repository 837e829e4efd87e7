# Definitions for the rules: the checked configuration, its jobs and paths, and functions that refer to other rules.

import json
import os
import re
import sys
from pathlib import Path

from coronaryuq.core.private_folders import complete_environment

complete_environment()  # before matplotlib is imported, which makes its folders in the home that it finds

from coronaryuq.campaign import drawings, index, start, variants
from coronaryuq.campaign.paths import Paths, files_under
from coronaryuq.campaign.searches import Searches
from coronaryuq.campaign.targets import Targets, within
from coronaryuq.core import provenance, shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.launcher import FORGET_OUTER_RANKS, LOCAL_MPIEXEC, check_programs
from coronaryuq.figures.draw import module_of
from coronaryuq.report.captions import INVENTED, SEARCHES, category_of, category_of_search, labels_of


# The container of every job; built from envs/coronaryuq.def, used with --software-deployment-method apptainer.
container: "envs/coronaryuq.sif"


# Jobs find this environment's python and mpiexec whether or not it is activated, and are no ranks of an outer launcher.
bin = Path(sys.executable).parent.as_posix()
shell.prefix('set -euo pipefail; export PATH={bin:q}:"$PATH"; {FORGET_OUTER_RANKS}; ')
if re.search(r"\s", sys.executable):  # Snakemake starts scripts by this path, unquoted; on the PATH it is `python`
    sys.executable = "python"


try:
    check_programs("bash")
    start.check_place(workflow.main_snakefile)
    given = start.read_campaign(config, workflow.configfiles, shipped.configuration("laptop"))
    campaign, paths = given.campaign, Paths(given.campaign.name)
    results, log_of, cost_of = paths.results, paths.log, paths.cost
    targets = Targets(campaign)
    adopts = campaign.discrepancy.adopt
    # The search reads a tuned loop: with adoption, the one before it.
    tuned = results("adopted", "before", "rest.json") if adopts else results("calibration", "rest.json")
    searches = Searches(campaign.discrepancy, paths, tuned, campaign.case == "bundled", given.measurements)
    searches.check()
    start.announce(campaign, workflow.main_snakefile)
except InputError as error:
    start.refuse(error)

figures, paper_figures = drawings.figures(campaign, paths), drawings.paper_figures(paths)
meshes, runs_3d = variants.meshes(campaign), variants.runs_3d(targets)
study = variants.study_levels(targets, given.lumen)
assumes_mesh_error = variants.assumes_mesh_error(campaign, given.lumen)
teaches = variants.teaches(campaign, given.in_3d)
cached = start.cache_is_writable()
# To be tuned: the case's network, or that with the losses that 3D runs taught it, see losses.smk.
untuned = results("losses", "network.json") if teaches else results("case", "network.json")

# What calibration and posterior are fitted to: the map's flows, without the errors of the map that a search named.
target_flows = results("adopted", "targets.json") if adopts else results("perfusion", "targets.json")


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
    length=r"[1-9]\d*",


def stage(function, *modules):
    """Return the parameters of a job: its function, MODULE:FUNCTION, and the digest of its code and other modules."""
    behind = (function.partition(":")[0], *modules)
    return {"function": function, "code": lambda wildcards: provenance.code_digest(*behind)}


def drawing(name):
    """Return the parameters of a job that draws the figure `name` of its wildcards."""
    function = "coronaryuq.campaign.jobs.figure:draw_figure"
    return {
        "function": function,
        "code": lambda wildcards: provenance.code_digest("coronaryuq.figures.draw", module_of(name(wildcards))),
        "name": name,
    }


def block(name, without=()):
    """Return the settings of one stage, without counts, which can change without making results invalid."""
    return getattr(campaign, name).model_dump(mode="json", exclude=set(without))


def as_json(job, **values):
    """Return the parameters of a job that is started from the shell."""
    return json.dumps(job | {"code": job["code"](None)} | values, sort_keys=True)


def alternatives(names):
    """Return the constraint of a wildcard to some names; a rule without any makes nothing."""
    return "|".join(map(re.escape, names)) or "none"


def mesh_of(wildcards):
    """Return the mesh of 3D runs."""
    folder = runs_3d[wildcards.run].mesh
    return {"mesh_dir": results(folder, "mesh-complete"), "mesh_json": results(folder, "mesh.json")}


def decision(number):
    """Return the decision of round `number` of a growing campaign; Snakemake runs the round first."""
    return read_json(checkpoints.allocation.get(r=number).output.round_json)


def last_round():
    """Return the round after which a growing campaign stops."""
    return next(number for number in range(campaign.estimation.rounds) if decision(number)["done"])


FIRST_CHAINS = [[0, 1]]
"""Lengths of the chains behind all samples of the first round: from the first sample on, 1."""


def lengths_of_campaign():
    """Return the lengths of the chains behind the propagation samples: each with the first sample drawn from it."""
    return decision(last_round())["counts"]["lengths"] if targets.grows else FIRST_CHAINS


def lengths_of_chunk(wildcards):
    """Return the lengths of the chains when the round came that needs a chunk first; the pilot is of the first ones."""
    if not targets.grows or wildcards.set == "pilot":
        return FIRST_CHAINS
    if int(wildcards.k) in targets.needed(targets.first_counts)["zerod_propagation"]:
        return FIRST_CHAINS
    for number in range(campaign.estimation.rounds):
        held = decision(number)
        if held["done"] or int(wildcards.k) in targets.needed(held["next"])["zerod_propagation"]:
            return held["next"]["lengths"]


def draws(lengths):
    """Return the table of draws of the chains of the last of some lengths."""
    return results("posterior", f"length_{lengths[-1][1]}", "draws.csv")


def shorter_chains(wildcards):
    """Return the chains, half as long, from which chains continue; none for the first ones."""
    length = int(wildcards.length)
    return [results("posterior", f"length_{length // 2}", "chains.npz")] if length > 1 else []


def longest_chains(wildcards):
    """Return the chains of the campaign's last round, by name."""
    return {"chains_npz": results("posterior", f"length_{lengths_of_campaign()[-1][1]}", "chains.npz")}


def draws_of_set(wildcards):
    """Return the table of draws of an input set, and the last decision of a campaign whose propagation samples grow."""
    if wildcards.set == "pilot":
        return {"draws_csv": draws(FIRST_CHAINS)}
    return {"draws_csv": draws(lengths_of_campaign())} | end_of_growth(wildcards)


def counts_of_campaign():
    """Return the numbers of 3D and 0D runs of the campaign."""
    return decision(last_round())["counts"] if targets.grows else targets.first_counts


def runs_of(counts):
    """Return the files of the first `counts` runs."""
    ks = targets.needed(counts)
    return {
        "records": expand(results("flow3d", "batch_{k}.jsonl"), k=ks["flow3d"]),
        "coarse": expand(results("coarse", "batch_{k}.jsonl"), k=ks["coarse"]),
        "zerod_pilot": expand(results("zerod", "pilot_{k}.parquet"), k=ks["zerod_pilot"]),
        "zerod_propagation": expand(results("zerod", "propagation_{k}.parquet"), k=ks["zerod_propagation"]),
    }


def runs_of_round(wildcards):
    """Return the runs and the draws of a round of a growing campaign, and the decision that requested them."""
    number = int(wildcards.r)
    if number == 0:
        return runs_of(targets.first_counts) | {"draws_csv": draws(FIRST_CHAINS)}
    counts, before = decision(number - 1)["next"], results("allocation", f"round_{number - 1}.json")
    return runs_of(counts) | {"draws_csv": draws(counts["lengths"]), "before": before}


def end_of_growth(wildcards):
    """Return the last decision of a growing campaign, by name."""
    return {"allocation": results("allocation", f"round_{last_round()}.json")} if targets.grows else {}


def runs_of_campaign(wildcards):
    """Return the files of all runs of the campaign."""
    return runs_of(counts_of_campaign()) | end_of_growth(wildcards)


def answers_required(wildcards):
    """Return the answers of all searches, or refuse a campaign that has nothing to search."""
    try:
        return searches.required()
    except InputError as error:
        start.refuse(error)


def adoption_required(wildcards):
    """Return the comparison before and after adoption, or refuse a campaign that adopts nothing."""
    if not adopts:
        start.refuse(InputError("configuration", "discrepancy.adopt", False, "nothing is adopted; set true"))
    return results("adopted", "comparison.json")


def costs_of_study():
    """Costs of the jobs of the mesh study."""
    return [
        *(cost_of(f"{level}/mesh.json") for level in study if level in meshes),
        *(cost_of(f"{level}/batch_0.json") for level in study),
    ]


def costs_of_campaign(wildcards):
    """Return the costs of the jobs that computed the contents of the report."""
    ks = targets.needed(counts_of_campaign())
    stages = ("case", "perfusion", "calibration", "posterior", "mesh/mesh", "runs")
    return [
        *(cost_of(f"{name}.json") for name in (*stages, "estimation_train", "estimation")),
        *expand(cost_of("perfusion_chunk_{k}.json"), k=targets.realisations),
        *expand(cost_of("posterior_chains_{length}.json"), length=[length for _, length in lengths_of_campaign()]),
        *expand(cost_of("flow3d/batch_{k}.json"), k=ks["flow3d"]),
        *expand(
            cost_of("coarse/{job}.json"), job=[*["mesh"] * bool(ks["coarse"]), *(f"batch_{k}" for k in ks["coarse"])]
        ),
        *(costs_of_study() if campaign.flow3d.mesh_study else []),
        *([cost_of(f"losses/{job}.json") for job in ("calibration", "runs", "fit")] if teaches else []),
        *([cost_of(f"adopted/{job}.json") for job in ("calibration", "chains_1", "before", "after")] if adopts else []),
        *expand(cost_of("zerod/pilot_{k}.json"), k=ks["zerod_pilot"]),
        *expand(cost_of("zerod/propagation_{k}.json"), k=ks["zerod_propagation"]),
        *expand(cost_of("zerod/resampled_{k}.json"), k=targets.shares),
        *expand(cost_of("discrepancy_search_{case}.json"), case=searches.cases if searches.in_report else []),
    ]
