"""A results folder, possibly incomplete."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from coronaryuq import config
from coronaryuq.campaign import explain
from coronaryuq.core.errors import InputError


@dataclass(frozen=True)
class ResultsFolder:
    """The folder `results/NAME` of a campaign that is running or has run."""

    home: Path

    @property
    def name(self) -> str:
        return self.home.resolve().name

    @cached_property
    def configuration(self) -> config.Campaign:
        """The configuration of the campaign's last run; `InputError` if another version wrote it."""
        self.check()
        return config.load(self.home / explain.CAMPAIGN)

    def check(self) -> None:
        """Raise `InputError` if the folder is not that of a campaign."""
        if not (self.home / explain.CAMPAIGN).is_file():
            raise InputError(
                self.home, None, None, f"not the results folder of a campaign: it has no {explain.CAMPAIGN}"
            )

    def path(self, *parts: str) -> Path:
        """Return the path of a result.

        Raises
        ------
        InputError
            If it has not been computed yet; names the target to run.
        """
        path = self.home.joinpath(*parts)
        if not path.exists():
            target = "/".join(("results", self.name, *parts))
            raise InputError(path, None, None, f"not computed yet; run the campaign, or its target {target}")
        return path
