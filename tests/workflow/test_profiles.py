"""The profile for SLURM gives every job what it needs."""

import re
from pathlib import Path

import yaml

WORKFLOW = Path(__file__).parents[2] / "workflow"


def rules_with(text):
    """Names of the rules whose body contains a text."""
    found = set()
    for file in sorted((WORKFLOW / "rules").glob("*.smk")):
        _, *bodies = re.split(r"^rule (\w+):$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
        found |= {name for name, body in zip(bodies[::2], bodies[1::2], strict=True) if text in body}
    return found


def test_every_rule_that_runs_3d_samples_has_the_resources_of_a_batch():
    """With svSolver the runs that teach the 0D losses take as long as others."""
    resources = yaml.safe_load((WORKFLOW / "profiles" / "slurm" / "config.yaml").read_text(encoding="utf-8"))
    solve = rules_with("coronaryuq.campaign.jobs.flow3d:")
    in_3d = {name for name in solve if name in rules_with('campaign.backend in ("svsolver"')}
    assert {"flow3d_batch", "losses_runs"} <= in_3d
    own = resources["set-resources"]
    assert {name: own.get(name) for name in in_3d} == dict.fromkeys(in_3d, own["flow3d_batch"])
