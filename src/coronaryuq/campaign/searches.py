"""The cases of the discrepancy search: their files, their tables for figures, and missing inputs."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from coronaryuq.campaign.paths import Paths
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import visible
from coronaryuq.discrepancy.data.conditions import drive_paths
from coronaryuq.discrepancy.data.pullbacks import has_pullback
from coronaryuq.discrepancy.settings import GIVEN, Settings
from coronaryuq.report.captions import INVENTED, PAIRS_TABLES

CASE = {"model": "model.json", "measurements": "measurements.csv", "conditions": "conditions.yaml"}
HIDING = {"hidden_effect", "hidden_size"}
INPUTS = {
    *("model", "measurements", "conditions", "pairs", "recordings", "animals"),
    *("held_out", "free_bed", "in_report", "adopt", "benchmark"),
}
"""Settings of the cases, as opposed to those of the search."""
TABLES = ("tree", "residuals", "ranking", "sizes", "gap")
WITH_NAMES = {"tree", "residuals", "ranking", "sizes", "pullback"}
"""Figures that name vessels, beds or places."""


@dataclass(frozen=True)
class Searches:
    """Searches of one campaign.

    The cases are the measurements in the settings or else those of the patient's case, recorded animals, and pairs of
    simulated and measured outputs. If there are none, the bundled patient's campaign tests the search itself: an effect
    is hidden in its tuned loop. In a loop of anyone else nothing is hidden, because an invented effect must not be read
    as one of that patient.

    settings: block `discrepancy`; paths: of the campaign; tuned: the campaign's tuned loop at rest; bundled: whether
    its case is the bundled patient; measured: table of measurements and conditions of the case.
    """

    settings: Settings
    paths: Paths
    tuned: str
    bundled: bool
    measured: tuple[str, str] | None = None

    def made(self, case: str) -> dict[str, str]:
        """Return the files of a case that a rule writes."""
        return {name: self.paths.discrepancy(case, "case", file) for name, file in CASE.items()}

    @cached_property
    def cases(self) -> dict[str, dict[str, Any]]:
        """Files of every case that is a network with measurements."""
        settings = self.settings
        cases: dict[str, dict[str, Any]] = {
            animal: self.made(animal) | {"drives": self.paths.discrepancy(animal, "case", "drives")}
            for animal in settings.animals
        }
        if settings.measurements and settings.conditions:
            measured: tuple[str, str] | None = (settings.measurements, settings.conditions)
        else:
            measured = None if settings.pairs or settings.animals else self.measured
        if measured:
            table, conditions = measured
            cases["case"] = {
                "model": settings.model or self.tuned,
                "measurements": table,
                "conditions": conditions,
                "drives": drive_paths(conditions),
            }
        return cases or ({INVENTED: self.made(INVENTED)} if self.bundled and not settings.pairs else {})

    @property
    def in_report(self) -> bool:
        """Whether the searches are part of the campaign and its report: by default if the case has measurements."""
        wanted = self.settings.in_report
        return self.adopted is not None or bool(self.names) and ("case" in self.cases if wanted is None else wanted)

    @property
    def adopted(self) -> str | None:
        """The case whose effects the campaign adopts, None if it adopts none.

        Raises
        ------
        InputError
            If the campaign searches no case whose effects it could adopt.
        """
        if not self.settings.adopt:
            return None
        found = next((case for case in ("case", INVENTED) if case in self.cases), None)
        if found is None:
            remedy = (
                "this campaign searches no measurements of its loop; give measurements and conditions, or set false"
            )
            raise InputError("configuration", "discrepancy.adopt", True, remedy)
        return found

    @cached_property
    def names(self) -> list[str]:
        """Names of all cases, a table model among them."""
        return [*self.cases, *(["pairs"] if self.settings.pairs else [])]

    def required(self) -> list[str]:
        """Return the answers for a page of searches.

        Raises
        ------
        InputError
            If there is nothing to search.
        """
        if not self.names:
            remedy = (
                "nothing to search: name measurements and conditions here or in the case, recordings or pairs "
                "(an effect is hidden in the bundled patient's loop only)"
            )
            raise InputError("configuration", "discrepancy.measurements", None, remedy)
        return self.answers

    @cached_property
    def answers(self) -> list[str]:
        """Answer to every case."""
        return [self.paths.discrepancy(case, "found", "discrepancy.json") for case in self.names]

    @cached_property
    def tables(self) -> dict[tuple[str, str], str]:
        """Case and figure → the table from which the figure is drawn."""
        tables = {
            (case, name): self.paths.discrepancy(case, "found", f"{name}.csv")
            for case, files in self.cases.items()
            for name in (*TABLES, *(["pullback"] if has_pullback(files["measurements"]) else []))
        }
        # A recorded artery is an open loop, in which an unknown source of flow has a node.
        tables |= {(animal, "source"): self.paths.discrepancy(animal, "found", "source.csv") for animal in self.animals}
        if INVENTED in self.cases:
            tables[INVENTED, "gap"] = self.paths.discrepancy(INVENTED, "known", "gap.csv")
        if self.settings.pairs:
            for name, table in PAIRS_TABLES.items():
                tables["pairs", name] = self.paths.discrepancy("pairs", "found", f"{table}.csv")
        return tables

    @property
    def animals(self) -> list[str]:
        """Recorded animals."""
        return [animal for animal in self.settings.animals if animal in self.cases]

    @cached_property
    def of_patient(self) -> list[str]:
        """Cases whose network is the campaign's, so that its parts have the patient's names."""
        own = (self.tuned, self.made(INVENTED)["model"])
        return [case for case, files in self.cases.items() if files["model"] in own]

    @property
    def anatomy(self) -> dict[str, str]:
        """The case and its tree, in which the parts of its network have names that a reader knows."""
        return {"case": self.paths.results("case", "case.json"), "tree": self.paths.results("case", "tree.vtp")}

    def drawn_from(self, case: str, figure: str) -> dict[str, str]:
        """Return the files from which a figure is drawn, by the parameter's name of the function that draws it."""
        named = figure in WITH_NAMES and case in self.of_patient
        return {"table": self.tables[case, figure]} | (self.anatomy if named else {})

    @cached_property
    def figures(self) -> list[str]:
        """Figures of all cases."""
        return [self.paths.discrepancy(case, "figures", f"{name}.png") for case, name in self.tables]

    def recordings(self, animal: str) -> list[str]:
        """Return the recorded files of an animal."""
        return [path.as_posix() for path in visible(self.settings.recordings or "", f"{animal}_*.csv")]

    def block(self, *, hiding: bool) -> dict[str, Any]:
        """Return the settings of the search, with or without those of the hidden effect."""
        return self.settings.model_dump(mode="json", exclude=INPUTS if hiding else INPUTS | HIDING)

    def shown(self) -> dict[str, Any]:
        """Return the settings shown on the page of the searches."""
        hidden = set() if INVENTED in self.cases else HIDING
        return self.settings.model_dump(mode="json", exclude={"benchmark"} | hidden)

    def hidden_in(self, network: str) -> dict[str, str]:
        """Return the network file in which the benchmark hides effects; none for the bundled open loop."""
        chosen = self.settings.benchmark.named[network]
        return {"campaign": {"network": self.tuned}, "open_loop": {}}.get(chosen, {"network": chosen})

    def check(self) -> None:
        """Raise `InputError` for a file, an animal or a condition in the settings that does not exist."""
        _ = self.adopted
        for field, path in self._named():
            if path and not Path(path).is_file():
                raise InputError("configuration", f"discrepancy.{field}", path, "no such file")
        folder, recorded = self.settings.recordings, set()
        for animal in self.settings.animals:
            files = self.recordings(animal)
            if not files:
                remedy = f"no {animal}_CONDITION.csv in {folder}"
                raise InputError("configuration", "discrepancy.animals", animal, remedy)
            recorded |= {Path(file).stem.removeprefix(f"{animal}_") for file in files}
        for name in self.settings.held_out or ():
            if name not in recorded:
                remedy = f"not recorded; recorded are {', '.join(sorted(recorded))}"
                raise InputError("configuration", "discrepancy.held_out", name, remedy)

    def _named(self) -> Iterator[tuple[str, str | None]]:
        settings = self.settings
        yield "model", settings.model
        yield "measurements", settings.measurements
        yield "conditions", settings.conditions
        yield from (("conditions", str(path)) for path in self.cases.get("case", {}).get("drives", ()))
        yield from (("pairs", path) for path in settings.pairs or ())
        yield from (("benchmark.networks", path) for path in settings.benchmark.named.values() if path not in GIVEN)
