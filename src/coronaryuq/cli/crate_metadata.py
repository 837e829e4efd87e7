"""Metadata of a campaign's RO-Crate: a Provenance Run Crate (https://w3id.org/ro/wfrun/provenance/0.5).

The workflow's run and every job are actions, with their inputs and outputs, parameters, times and costs. A rule is a
step of the workflow; the function that it calls is the step's tool.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rocrate.model import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

from coronaryuq.campaign import explain
from coronaryuq.core import provenance

WORKFLOW = "workflow/Snakefile"
RUNNER = ("function", "code")
"""Parameters of a job that name its tool."""
PROFILES = {"process": "Process", "workflow": "Workflow", "provenance": "Provenance"}
TERMS = "https://w3id.org/ro/terms/workflow-run#"
PARAMETER_PROFILE = "https://bioschemas.org/profiles/FormalParameter/1.0-RELEASE"
NO_LICENCE = "No licence is granted for the data of this campaign; the file LICENSE licenses the workflow."
UNITS = {"wall_s": "s", "cpu_s": "s", "memory_mb": "MB"}
FORMATS = {
    ".json": "application/json", ".jsonl": "application/jsonl", ".csv": "text/csv", ".html": "text/html",
    ".png": "image/png", ".yaml": "application/yaml", ".zip": "application/zip", ".log": "text/plain",
    ".nc": "application/x-netcdf", ".parquet": "application/vnd.apache.parquet",
}  # fmt: skip


@dataclass(frozen=True)
class Credits:
    """Person who ran the campaign with their ORCID, and licence of its data; None where not given."""

    agent: str | None = None
    orcid: str | None = None
    license: str | None = None


@dataclass(frozen=True)
class Packed:
    """A campaign: its notes by time, names of files in the crate, and its possible files by name.

    name_of: from a path in a note to a name in the crate, None for a file of the package. carried: files of every
    crate; data: inputs and results.
    """

    name: str
    notes: list[dict]
    name_of: Callable[[str], str | None]
    carried: dict[str, Path]
    data: dict[str, Path]


def describe(campaign: Packed, files: Mapping[str, Path], credits: Credits) -> dict[str, Any]:
    """Return the metadata document of a crate with `files`."""
    return _Description(campaign, files, credits).document()


class _Description:
    def __init__(self, campaign: Packed, files: Mapping[str, Path], credits: Credits):
        self.campaign, self.files = campaign, files
        self.crate = ROCrate(version="1.1")
        self.crate.metadata.extra_terms = {name: f"{TERMS}{name}" for name in ("resourceUsage", "sha256")}
        self.contents = self._checksums()
        self.agent = self._agent(credits)
        self._root(credits)
        self.engine = self._add(
            "#snakemake", "SoftwareApplication", name="Snakemake", url="https://snakemake.github.io",
            softwareVersion=self._newest["libraries"].get("snakemake", "unknown"),
        )  # fmt: skip
        self.workflow = self._workflow()
        self.entities = {name: self._file(name) for name in files if name != WORKFLOW} | {WORKFLOW: self.workflow}
        self.crate.root_dataset["license"] = self._licence(credits)

    @property
    def _newest(self) -> dict:
        return self.campaign.notes[-1]

    def document(self) -> dict[str, Any]:
        """Add the actions and return the whole."""
        for position, rule in enumerate(self._rules(), start=1):
            self._step(rule, position)
        actions = [self._job(note) for note in self.campaign.notes]
        self._run(actions)
        return self.crate.metadata.generate()

    def _add(self, identifier: str, type_: str | list[str], **properties: Any) -> Entity:
        known = self.crate.dereference(identifier)
        if known is not None:
            return known
        given = {name: value for name, value in properties.items() if value is not None}
        entity = self.crate.add(ContextEntity(self.crate, identifier, {"@type": type_}))
        for name, value in given.items():
            entity[name] = value
        return entity

    def _checksums(self) -> dict[str, str]:
        """Return the checksum of every file that a note mentions, by its name in the crate."""
        found = {}
        for note in self.campaign.notes:
            for path, content in [*note["inputs"].items(), *note["results"].items()]:
                name = self.campaign.name_of(path)
                if name is not None:
                    found[name] = content
        return found

    def _root(self, credits: Credits) -> None:
        root = self.crate.root_dataset
        root["name"] = f"coronaryuq campaign {self.campaign.name}"
        root["description"] = (
            "Predictions of one patient's coronary haemodynamics with their uncertainty: workflow, configuration, "
            "inputs, results, and every job that made them. For research only; not a medical device."
        )
        root["datePublished"] = self._newest["made"]
        if self.agent:
            root["author"] = self.agent
        profiles = [
            self._add(f"https://w3id.org/ro/wfrun/{key}/0.5", "CreativeWork", name=f"{name} Run Crate", version="0.5")
            for key, name in PROFILES.items()
        ]
        workflow = "https://w3id.org/workflowhub/workflow-ro-crate/1.0"
        root["conformsTo"] = [*profiles, self._add(workflow, "CreativeWork", name="Workflow RO-Crate", version="1.0")]

    def _agent(self, credits: Credits) -> Entity | None:
        if credits.agent is None:
            return None
        return self._add(credits.orcid or f"#{quote(credits.agent)}", "Person", name=credits.agent)

    def _licence(self, credits: Credits) -> Entity:
        if credits.license:
            return self._add(credits.license, "CreativeWork", name=credits.license)
        return self._add("#licence-of-data", "CreativeWork", name="No licence", description=NO_LICENCE)

    def _workflow(self) -> Entity:
        workflow = self.crate.add_workflow(
            self.files[WORKFLOW], WORKFLOW, main=True, lang="snakemake",
            properties={
                "@type": ["File", "SoftwareSourceCode", "ComputationalWorkflow", "HowTo"],
                "name": "coronaryuq",
                "description": "Snakemake workflow: from one patient's anatomy and perfusion to quantities of interest "
                "with confidence intervals.",
                "version": provenance.code_version(),
                "license": {"@id": "https://spdx.org/licenses/BSD-3-Clause"},
            },
        )  # fmt: skip
        self._add("https://spdx.org/licenses/BSD-3-Clause", "CreativeWork", name="BSD 3-Clause License")
        return workflow

    def _file(self, name: str) -> Entity:
        source = self.files[name]
        described = {"name": name, **({"sha256": self.contents[name]} if name in self.contents else {})}
        if source.is_dir():
            return self.crate.add_dataset(source, name, properties={"name": name})
        described |= {"contentSize": str(source.stat().st_size)}
        if source.suffix in FORMATS:
            described["encodingFormat"] = FORMATS[source.suffix]
        return self.crate.add_file(source, name, properties=described)

    def _entity(self, name: str) -> Entity:
        """Return the entity of a file, or one that marks the file as not in the crate."""
        if name not in self.entities:
            self.entities[name] = self._add(
                f"#{quote(name)}", "CreativeWork", name=name, sha256=self.contents.get(name),
                description="This file is not in the crate.",
            )  # fmt: skip
        return self.entities[name]

    def _rules(self) -> list[str]:
        """Return the rules of the jobs, in the order in which their first jobs ended."""
        return list(dict.fromkeys(_rule(note) for note in self.campaign.notes))

    def _step(self, rule: str, position: int) -> None:
        notes = [note for note in self.campaign.notes if _rule(note) == rule]
        tool = self._tool(notes[-1])
        step = self._add(f"#step/{rule}", "HowToStep", name=rule, position=str(position))
        step["workExample"] = tool
        self.workflow.append_to("step", step)
        if tool not in self.workflow.get("hasPart", []):
            self.workflow.append_to("hasPart", tool)

    def _tool(self, note: dict) -> Entity:
        """Return the function behind a job; the same function with other code is another tool."""
        function, code = (note["params"].get(key, "") for key in RUNNER)
        function = function or _rule(note)
        identifier = f"#tool/{quote(function, safe='')}/{code}" if code else f"#tool/{quote(function, safe='')}"
        tool = self._add(
            identifier, "SoftwareApplication", name=function, softwareVersion=note["code"],
            description=f"Function of the Python package coronaryuq; code digest {code or 'unknown'}.",
        )  # fmt: skip
        for name in _parameters(note):
            self._parameter(tool, name)
        return tool

    def _parameter(self, tool: Entity, name: str) -> Entity:
        identifier = f"{tool.id}/{quote(name)}"
        known = self.crate.dereference(identifier)
        if known is not None:
            return known
        parameter = self._add(
            identifier, "FormalParameter", name=name, additionalType="Text", conformsTo={"@id": PARAMETER_PROFILE}
        )
        tool.append_to("input", parameter)
        return parameter

    def _job(self, note: dict) -> Entity:
        """Add the action of a job and the action of Snakemake that started it; return the second."""
        tool = self._tool(note)
        identifier = quote(note["job"])
        action = self._add(
            f"#job/{identifier}", "CreateAction", name=note["job"], instrument=tool, agent=self.agent,
            description=f"Ran with Python {note['python']} on {note['machine']['system']}.",
            startTime=_started(note), endTime=note["made"],
            actionStatus={"@id": "http://schema.org/CompletedActionStatus"},
        )  # fmt: skip
        inputs = [name for path in note["inputs"] if (name := self.campaign.name_of(path)) is not None]
        objects = [self._entity(name) for name in inputs]
        action["object"] = objects + [self._value(tool, name, note) for name in _parameters(note)]
        latest = {name for name in note["results"] if self._latest(name) is note}
        action["result"] = [self._entity(name) for name in note["results"] if name in latest]
        action["resourceUsage"] = [self._usage(identifier, *pair) for pair in note["resources"].items()]
        return self._add(
            f"#control/{identifier}", "ControlAction", name=f"start of {note['job']}",
            instrument=self._add(f"#step/{_rule(note)}", "HowToStep"), object=action,
        )  # fmt: skip

    def _latest(self, result: str) -> dict:
        return next(note for note in reversed(self.campaign.notes) if result in note["results"])

    def _value(self, tool: Entity, name: str, note: dict) -> Entity:
        value = note["params"][name]
        text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        parameter = self._parameter(tool, name)
        entity = self._add(
            f"#value{parameter.id[5:]}/{provenance.digest(text)}", "PropertyValue", name=name, value=text
        )
        if entity.get("exampleOfWork") is None:
            entity["exampleOfWork"] = parameter
            parameter.append_to("workExample", entity)
        return entity

    def _usage(self, job: str, name: str, value: float) -> Entity:
        return self._add(
            f"#usage/{job}/{name}", "PropertyValue", name=name, propertyID=f"#{name}", value=str(value),
            unitText=UNITS.get(name),
        )  # fmt: skip

    def _run(self, actions: Iterable[Entity]) -> None:
        """Add the action of the whole workflow, and that of the engine which started the jobs."""
        notes = self.campaign.notes
        made = {name for note in notes for name in note["results"]}
        read = {name for note in notes for path in note["inputs"] if (name := self.campaign.name_of(path)) is not None}
        configuration = f"results/{self.campaign.name}/{explain.CAMPAIGN}"
        given = [configuration, *sorted(read - made)]
        run = self._add(
            "#run", "CreateAction", name=f"run of the campaign {self.campaign.name}", instrument=self.workflow,
            agent=self.agent, startTime=min(map(_started, notes)), endTime=self._newest["made"],
            actionStatus={"@id": "http://schema.org/CompletedActionStatus"},
        )  # fmt: skip
        run["object"] = [self._entity(name) for name in given]
        run["result"] = [self._entity(name) for name in sorted(made - read)]
        parameter = self._add(
            "#configuration", "FormalParameter", name="configuration", additionalType="File",
            encodingFormat="application/yaml", conformsTo={"@id": PARAMETER_PROFILE},
            workExample=self._entity(configuration),
        )  # fmt: skip
        self._entity(configuration)["exampleOfWork"] = parameter
        self.workflow["input"] = parameter
        self.crate.root_dataset["mentions"] = run
        self._add(
            "#campaign", "OrganizeAction", name="Snakemake's run of the campaign", instrument=self.engine,
            agent=self.agent, result=run, object=list(actions),
        )  # fmt: skip


def _rule(note: Mapping) -> str:
    return re.split("[ /]", note["job"])[0]


def _parameters(note: Mapping) -> list[str]:
    return [name for name in note["params"] if name not in RUNNER]


def _started(note: Mapping) -> str:
    """Return the time at which a job started: its end less its wall time, to the second as its end is."""
    ended = datetime.fromisoformat(note["made"])
    return (ended - timedelta(seconds=round(note["resources"].get("wall_s", 0)))).isoformat()
