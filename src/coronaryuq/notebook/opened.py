"""A campaign's results as tables and objects of the usual libraries."""

from collections.abc import Mapping
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coronaryuq.campaign import files
from coronaryuq.campaign.explain import Origin, explain
from coronaryuq.campaign.results import ResultsFolder
from coronaryuq.case.network.network import Network
from coronaryuq.config import Campaign
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.io.text import visible
from coronaryuq.estimation.results import RowReport, read_estimates
from coronaryuq.zerod.network.read import read_network

if TYPE_CHECKING:
    import pandas as pd

UNITS = "units"
"""Key of `DataFrame.attrs` with the unit of every column."""


class Figure:
    """A figure of a campaign, displayed by notebooks; `path` is its file."""

    def __init__(self, path: Path):
        self.path = path

    def __repr__(self) -> str:
        return str(self.path)

    def _repr_png_(self) -> bytes:
        return self.path.read_bytes()


class Opened:
    """The results of a campaign, read on access.

    A result that has not been computed yet raises a one-line `InputError` that names the target to run. Tables are
    pandas DataFrames with the unit of every column in `attrs["units"]`.

    Parameters
    ----------
    home
        Results folder, `results/NAME`.
    """

    def __init__(self, home: str | Path):
        self._folder = ResultsFolder(Path(home))
        self._folder.check()

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self._folder.name

    @property
    def path(self) -> Path:
        """Results folder."""
        return self._folder.home

    @property
    def configuration(self) -> Campaign:
        """Every setting of the last run."""
        return self._folder.configuration

    @cached_property
    def ffr(self) -> "pd.DataFrame":
        """Fractional flow reserve of every stenosed artery, by the recommended estimator.

        Returns
        -------
        pandas.DataFrame
            Index: artery. `mean`: mean of FFR over the posterior of the outlet resistances. `std`, `low`, `high`:
            reported standard error and calibrated 95 % interval of that mean; they cover only the error of estimating
            it from a finite number of runs, not the posterior spread and not the error of mesh and model. `q05`,
            `median`, `q95`: quantiles of FFR over the posterior. `P(zone)`: probability of each zone of FFR, such as
            `P(FFR ≤ 0.75)`. `estimator`; `warnings`: reasons for caution.
        """
        import pandas as pd

        rows = {}
        for row in self._rows:
            if row.column_3d.startswith("ffr_"):
                rows[row.column_3d.removeprefix("ffr_").upper().replace("LCX", "LCx")] = _ffr(row)
        table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("artery")
        table.attrs[UNITS] = {name: "text" if name in ("estimator", "warnings") else "1" for name in table.columns}
        return table

    @cached_property
    def estimates(self) -> "pd.DataFrame":
        """Every estimator of every quantity, one line each (`estimation/table.csv`).

        Returns
        -------
        pandas.DataFrame
            `mean` is the estimated mean over the posterior, `std` its reported standard error; the intervals
            (`chebyshev_95_*`, `chebyshev_99_*`, `calibrated_*`) are for that mean and cover only the error of a finite
            number of runs. `unit` is that of these columns; `recommended` marks the estimator to quote.
        """
        table = self._table("estimation", "table.csv")
        attrs = dict(table.attrs)
        recommended = {row.row: row.recommended for row in self._rows}
        unit = files.units("runs/outputs_3d.csv", table["column_3d"])
        table.insert(6, "recommended", table["row"].map(recommended) == table["estimator"])
        table.insert(7, "unit", table["column_3d"].map(unit))
        table.attrs = {UNITS: attrs[UNITS] | {"recommended": "yes/no", "unit": "text"}}
        return table

    @cached_property
    def posterior(self) -> Any:
        """Posterior of the outlet resistances: a DataTree, as ArviZ 1 uses it.

        Groups: `posterior` with `r` (multiplier of r-hat, dimensionless) and `flow` (mL/s) by chain, draw and bed,
        `sample_stats` with the log density `lp`, `observed_data` with the target flows (mL/s).
        """
        import xarray

        return xarray.load_datatree(self._folder.path("posterior", "posterior.nc"), engine="h5netcdf")

    @cached_property
    def draws(self) -> "pd.DataFrame":
        """Thinned draws of the posterior: one multiplier of r-hat per bed."""
        return self._table("posterior", "draws.csv")

    @cached_property
    def runs(self) -> "Mapping[str, pd.DataFrame]":
        """Inputs and outputs of all runs, by the name of the file in `runs/`, each with index `sample`.

        `params` (pilot inputs), `outputs_3d`, `outputs_0d`, `params_propagation`, `outputs_0d_propagation`; with a
        coarse 3D level also `params_coarse`, `outputs_3d_coarse` and `outputs_0d_coarse`.
        """
        self._folder.path("runs", "rows.csv")
        found = {}
        for path in visible(self.path / "runs", "*.csv"):
            if path.name != "rows.csv":
                table = self._table("runs", path.name)
                found[path.stem] = table.set_index("sample")
                found[path.stem].attrs = table.attrs
        return found

    @cached_property
    def network(self) -> Network:
        """The tuned closed loop under hyperaemia: svZeroDSolver's JSON as a dictionary, CGS."""
        return read_network(self._folder.path("calibration", "hyperaemia.json"))

    @property
    def figures(self) -> dict[str, Figure]:
        """Figures by name; a notebook shows the last one in a cell."""
        folder = self._folder.path("figures")
        return {path.stem: Figure(path) for path in visible(folder, "*.png")}

    @property
    def report(self) -> Path:
        """The report, a page that opens in any browser: `webbrowser.open(c.report.resolve().as_uri())`."""
        return self._folder.path("report.html")

    def explain(self, result: str) -> Origin:
        """Return the origin of a result.

        Parameters
        ----------
        result
            Path in the results folder, such as `estimation/table.csv`.

        Raises
        ------
        InputError
            If no job wrote it.
        """
        path = self.path / result
        if not path.exists():
            there = [p.relative_to(self.path).as_posix() for p in self.path.rglob("*") if p.is_file()]
            raise InputError(path, None, None, f"no such result; {nearest(result, there)}name a file of {self.path}")
        return explain(path)

    @cached_property
    def _rows(self) -> list[RowReport]:
        return read_estimates(self._folder.path("estimation", "estimates.json")).rows

    def _table(self, *parts: str) -> "pd.DataFrame":
        table = read_csv(self._folder.path(*parts))
        table.attrs[UNITS] = files.units("/".join(parts), map(str, table.columns))
        return table

    def __repr__(self) -> str:
        return f"coronaryuq.open({str(self.path)!r})"

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if not name.startswith("_")]

    def _repr_html_(self) -> str:
        lines = [f"<h3>Campaign {escape(self.name)}</h3>", f"<p><code>{escape(str(self.path))}</code></p>"]
        try:
            settings = self.configuration
            case = "the bundled patient" if settings.case == "bundled" else settings.case
            lines.append(
                f"<p>{escape(case)}; {settings.samples.n_3d} 3D runs ({settings.backend}), {settings.samples.n_0d} 0D "
                f"runs per input set; seed {settings.seed}</p>"
            )
            shown = self.ffr.drop(columns=["std", "warnings"])
            lines.append("<p>FFR: the patient's spread; probability of each zone; mean with its 95 % interval</p>")
            lines.append(shown.to_html(float_format="{:.3f}".format))
        except InputError as error:
            lines.append(f"<p>{escape(str(error))}</p>")
        computed = [folder for folder in files.FOLDERS if (self.path / folder).is_dir()]
        lines.append(f"<p>Folders: {', '.join(computed)}</p>")
        return "\n".join(lines)


def _ffr(row: RowReport) -> dict[str, Any]:
    best, beyond = row.recommended_report, row.beyond_the_mean
    ranges = beyond.predictive or {}
    values: dict[str, Any] = {}
    for name, share in (("q05", "0.05"), ("median", "0.50"), ("q95", "0.95")):
        values[name] = ranges.get(share)
    values |= {f"P({zone.zone})": zone.value for zone in beyond.zones or []}
    values |= {"mean": best.mean, "std": best.std, "low": best.calibrated.low, "high": best.calibrated.high}
    return values | {"estimator": row.recommended, "warnings": "; ".join([*row.warnings, *best.warnings])}
