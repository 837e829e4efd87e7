"""Puts a campaign's results on one page for a cardiologist and an engineer: `report.html`, pictures included."""

import base64
import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from coronaryuq import provenance
from coronaryuq.files import read_csv, read_json, write_text
from coronaryuq.report import coarse_level, discrepancy
from coronaryuq.report.mesh_error import MeshError

ESTIMATORS = ("MC", "MFMC", "MFMC-AE", "BLUE", "best", "multilevel")
QUANTITIES = ("ffr", "tawss_min", "osi_max")
CAPTIONS = {
    "intervals_wss": "Maximum OSI and minimum TAWSS by estimator. An exclamation mark: the interval carries a warning.",
    "intervals_ffr": "FFR by estimator, with 0D FFR and with 0D mean flow as low-fidelity model.",
    "osi_scatter": "3D maximum OSI against 0D mean flow, at the same θ and at the input that the shared space pairs "
    "with it. Resampled values come from networks that did not see their sample.",
    "convergence": "Correlation and mean against the number of 3D runs; one dot a random subsample.",
    "budget": "What a further 3D or 0D run buys.",
    "cardiac_function": "The tuned loop at rest against its targets.",
    "marginals": "Posterior of every outlet's resistance as a multiple of r̂: histogram, mean, 95 % interval.",
    "flows": "Simulated outlet flows against the perfusion targets and their noise.",
    "flow_covariance": "Simulated flows of every pair of outlets; the ellipse holds 95 % of the targets' noise.",
    "territories": "Myocardial blood flow and the perfusion territory of every outlet.",
    "tree_ffr": "Mean pressure over mean aortic pressure along the tree, 0D, at the posterior mean.",
    "walls": "Time-averaged wall shear stress and oscillatory shear index of the first 3D sample.",
    "lumen": "Speed and pressure of the first 3D sample, means over a cycle, in a plane along each stenosis; the same "
    "colours mean the same values for all. Blood flows from left to right.",
}
PLACES = {
    "estimates": ("intervals_ffr", "intervals_wss", "osi_scatter", "convergence", "budget"),
    "matched": ("cardiac_function", "flows", "marginals", "flow_covariance"),
    "pictures": ("territories", "tree_ffr", "lumen", "walls"),
}
FFR_DECIMALS = 3
"""A pressure wire reads two; one more shows how near the threshold the mean lies."""
LIKELY = 0.9
"""How probable one side of the threshold has to be, over the whole interval, before the page takes it."""
COST = re.compile(r"cost: wall ([\d.]+) s, cpu ([\d.]+) s, memory (\d+) MB")


def write_report(
    files: Mapping[str, str],
    figures: Sequence[str],
    logs: str | Path,
    configuration: dict,
    out: str | Path,
    searches: tuple[Sequence[str], ...] = ((), ()),
) -> None:
    """Write the page. files: case, fit, summary, targets, failures, estimates, mesh → path, and mesh_study where it was
    run. figures: PNG files.

    logs: folder whose job logs end in a line of costs. searches: answers, figures and truths of searches for missing
    effects.
    """
    case, summary, targets = (read_json(files[name]) for name in ("case", "summary", "targets"))
    failures, estimates = read_json(files["failures"]), read_json(files["estimates"])
    rows = estimates["rows"]
    notes, mesh = _Notes(), MeshError(files["mesh"], files.get("mesh_study"))
    context = {
        "case": case,
        "campaign": configuration["name"],
        "backend": configuration["backend"],
        "threshold": f"{configuration['estimation']['ffr_threshold']:.2f}",
        "level": f"{100 * configuration['estimation']['level']:.0f} %",
        "counts": _counts(failures, rows),
        "vessels": [_vessel(stenosis, rows, _outlet_names(case), mesh) for stenosis in case["stenoses"]],
        "table": [_estimators(row, notes) | {"mesh": mesh.of(row["column_3d"])} for row in rows],
        "notes": notes.texts,
        "coarse_level": coarse_level.sentence(estimates),
        "mesh": mesh.sentence,
        "matched": _matched(read_csv(files["fit"]), summary),
        "noise": _noise(targets),
        "figures": _figures(figures),
        "searches": discrepancy.searches(*searches),
        "failed": _failed(failures),
        "costs": _costs(Path(logs)),
        "provenance": _provenance(estimates, files),
        "configuration": yaml.safe_dump(configuration, sort_keys=False),
    }
    write_text(out, discrepancy.environment().get_template("template.html").render(context))


def number(value: float | None, digits: int = 3) -> str:
    """A number for a reader: three significant digits, a dash where there is none."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}"


def correlation(value: float | None) -> str:
    """A correlation with as many nines as it has: 0.95, 0.9996."""
    if value is None or not np.isfinite(value):
        return "–"
    short_of_one = max(1 - abs(value), 1e-6)
    return f"{value:.{max(2, 1 - int(np.floor(np.log10(short_of_one))))}f}"


def interval(low: float, high: float) -> tuple[str, str]:
    """Both ends with as many decimals as their distance deserves."""
    decimals = max(0, min(6, 1 - int(np.floor(np.log10(high - low))))) if high > low else 3
    return f"{low:.{decimals}f}", f"{high:.{decimals}f}"


def _outlet_names(case: dict) -> dict[str, str]:
    """Input of the posterior → what a reader calls it."""
    names = {outlet["bc"]: f"{outlet['label']} ({outlet['name']})" for outlet in case["outlets"]}
    return names | {"R_cor_scaling": "total coronary resistance"}


def _vessel(stenosis: dict, rows: list[dict], outlets: Mapping[str, str], mesh: MeshError) -> dict:
    branch = stenosis["name"].lower()
    of_quantity = {q: _recommended(rows, f"{q}_{branch}") for q in QUANTITIES}
    ffr_row, ffr = of_quantity["ffr"]
    beyond = ffr_row["beyond_the_mean"]
    probability = beyond.get("probability_at_or_below")
    return {
        "name": stenosis["name"],
        "ffr": _quantity(ffr, FFR_DECIMALS) | {"mesh": mesh.of(f"ffr_{branch}")},
        "draws": _draws(beyond.get("quantiles", {})),
        "rare": _rare(beyond.get("quantiles", {})),
        "drivers": _drivers(beyond.get("sobol_first_order", {}), outlets),
        "quantities": [_quantity(value) | {"mesh": mesh.of(f"{q}_{branch}")} for q, (_, value) in of_quantity.items()],
        "significant": _probability(probability),
        "spread": f"{np.sqrt(ffr_row['variance_3d']):.{FFR_DECIMALS}f}",
        **_verdict(probability),
    }


def _recommended(rows: list[dict], column: str) -> tuple[dict, dict]:
    """Among the rows of one 3D column, the one whose recommended estimator claims the least error."""
    candidates = [(row, row["estimators"][row["recommended"]]) for row in rows if row["column_3d"] == column]
    return min(candidates, key=lambda pair: pair[1]["std"])


def _draws(quantiles: Mapping[str, dict]) -> str:
    """The outermost quantiles of FFR over the posterior, in words."""
    if len(quantiles) < 2:
        return ""
    ends = sorted(quantiles, key=float)
    low, high = (quantiles[end]["value"] for end in (ends[0], ends[-1]))
    share = 100 * (float(ends[-1]) - float(ends[0]))
    return f"{share:.0f} % of draws: {low:.2f} to {high:.2f}"


def _rare(quantiles: Mapping[str, dict]) -> str:
    """What the outermost quantiles of FFR over the posterior warn of."""
    warned = [end for end in sorted(quantiles, key=float) if "warning" in quantiles[end]]
    if not warned:
        return ""
    shares = " and ".join(f"{100 * float(end):.0f} %" for end in warned)
    return f"{shares} quantile: {quantiles[warned[0]]['warning']}."


def _drivers(sobol: Mapping[str, dict], outlets: Mapping[str, str], shown: int = 3) -> str:
    """The inputs with the largest first-order Sobol indices of FFR that are clear of zero."""
    clear = [(name, index) for name, index in sobol.items() if index["low"] > 0]
    largest = sorted(clear, key=lambda pair: -pair[1]["value"])[:shown]
    return ", ".join(f"{outlets.get(name, name)} {100 * index['value']:.0f} %" for name, index in largest)


def _quantity(value: dict, most_decimals: int = 6) -> dict:
    low, high = interval(value["calibrated"]["low"], value["calibrated"]["high"])
    decimals = min(len(low.partition(".")[2]), most_decimals)
    low, high = (f"{value['calibrated'][end]:.{decimals}f}" for end in ("low", "high"))
    level = f"{100 * value['calibrated']['level']:.0f} % interval"
    return {"value": f"{value['mean']:.{decimals}f}", "low": low, "high": high, "level": level}


def _probability(found: dict | None) -> dict:
    if found is None:
        return {"value": "–", "low": "–", "high": "–"}
    share = {name: 100 * min(max(found[name], 0.0), 1.0) for name in ("value", "low", "high")}
    decimals = 1 if share["high"] - share["low"] < 2 else 0
    return {name: f"{value:.{decimals}f} %" for name, value in share.items()}


def _verdict(found: dict | None) -> dict:
    if found is None:
        return {"class": "muted", "verdict": ""}
    if found["low"] > LIKELY:
        return {"class": "bad", "verdict": "It very likely limits flow."}
    if found["high"] < 1 - LIKELY:
        return {"class": "good", "verdict": "It very likely limits no flow."}
    return {"class": "warn", "verdict": "The data leave open whether it limits flow."}


class _Notes:
    """Warnings below the table, each once; a line of the table names them by number."""

    def __init__(self):
        self.texts: list[str] = []

    def numbers(self, warnings: Sequence[str]) -> str:
        for text in warnings:
            if text not in self.texts:
                self.texts.append(text)
        return " ".join(f"[{self.texts.index(text) + 1}]" for text in warnings)


def _estimators(row: dict, notes: _Notes) -> dict:
    quantity, paired, branch = (row["label"].split(", ") + ["", ""])[:3]
    lines = []
    for name in ESTIMATORS:
        if name not in row["estimators"]:
            continue
        value = row["estimators"][name]
        plain = name == "MC"
        lines.append(
            {
                "estimator": value["method"] + (" ✓" if name == row["recommended"] else ""),
                "mean": number(value["mean"], 4),
                "std": number(value["std"]),
                "chebyshev": " to ".join(interval(value["chebyshev_95"]["low"], value["chebyshev_95"]["high"])),
                "calibrated": " to ".join(interval(value["calibrated"]["low"], value["calibrated"]["high"])),
                "rho_in": "–" if plain else correlation(value.get("rho_in_sample")),
                "rho_out": "–" if plain else correlation(value["rho_held_out"]),
                "n_3d": value["n_3d"],
                "n_0d": "–" if plain else value["n_0d"],
                "notes": notes.numbers(value["warnings"] if plain else [*row["warnings"], *value["warnings"]]),
            }
        )
    return {"quantity": quantity, "paired": paired, "branch": branch, "lines": lines}


def _counts(failures: dict, rows: list[dict]) -> dict:
    flow3d, zerod = failures["flow3d"], failures["zerod"]
    resampled = sum(
        value["n_0d"] - value["n_3d"] for row in rows for name, value in row["estimators"].items() if name == "MFMC-AE"
    )
    per_3d = failures["cost"]["flow3d_cpu_s"] / max(flow3d["runs"], 1)
    per_0d = failures["cost"]["zerod_cpu_s"] / max(zerod["runs"], 1)
    return {
        "n_3d": flow3d["runs"],
        "n_3d_ok": flow3d["runs"] - len(flow3d["failed"]),
        "n_0d": zerod["runs"] + resampled,
        "note": f"One 3D run took {per_3d:.1f} CPU-s, one 0D run {per_0d:.4f} CPU-s on average: "
        f"a ratio of {per_3d / max(per_0d, 1e-12):.0f}.",
    }


def _matched(fit, summary: dict) -> dict:
    clinical = fit[fit["clinical"] & fit["tuned"]]
    off = (clinical["simulated"] / clinical["measured"] - 1).abs()
    worst = clinical.loc[off.idxmax(), "description"].lower()
    check, met = summary["predictive"], summary["fit"]["largest_fraction_error"]
    return {
        "calibration": f"The tuned loop meets the {len(clinical)} measured targets within {100 * off.max():.1f} % "
        f"(furthest: {worst}).",
        "posterior": f"Chains: {summary['verdict']}; largest R-hat {summary['rhat_max']:.3f}, smallest bulk effective "
        f"sample size {summary['ess_bulk_min']:.0f}.",
        "predictive": f"{100 * check['coverage_95']:.0f} % of the target flows lie in the central 95 % of what the "
        f"posterior predicts; Mahalanobis distance of the mean flows {check['mahalanobis']:.2f}; "
        f"probability of data further off {check['p_value']:.2f}. The fitted resistances meet the "
        f"{len(check['flow_mean'])} target fractions within {100 * met:.2g} %, the posterior's mean within "
        f"{100 * check['largest_fraction_error']:.2g} %, which its prior moves (posterior/fractions.csv).",
    }


def _noise(targets: dict) -> list[dict]:
    lines = []
    for name, model in targets["models"].items():
        correlation = np.array(model["correlation"], dtype=float)
        pairs = correlation[np.triu_indices(len(correlation), 1)]
        spread = 100 * np.array(model["relative_sd"])
        lines.append(
            {
                "name": name,
                "sd": f"{spread.min():.1f} to {spread.max():.1f}",
                "lowest": number(pairs.min(), 2),
                "highest": number(pairs.max(), 2),
                "used": "its correlations" if name == targets["use"] else "",
            }
        )
    return lines


def _figures(paths: Sequence[str]) -> dict:
    by_name = {Path(path).stem: path for path in paths}
    return {
        place: [
            {"caption": CAPTIONS[name], "data": _embedded(by_name[name])} for name in names if name in by_name
        ]
        for place, names in PLACES.items()
    }  # fmt: skip


def _embedded(path: str) -> str:
    return "data:image/png;base64," + base64.b64encode(Path(path).read_bytes()).decode()


def _failed(failures: dict) -> list[dict]:
    stages = (("3D", failures["flow3d"]["failed"]), ("0D", failures["zerod"]["failed"]))
    return [{"sample": f["sample"], "stage": stage, "reason": f["reason"]} for stage, failed in stages for f in failed]


def _costs(logs: Path) -> list[dict]:
    """Costs by rule, from the last line of every job's log."""
    found = defaultdict(lambda: {"jobs": 0, "wall": 0.0, "cpu": 0.0, "memory": 0.0})
    for path in sorted(logs.rglob("*.log")):
        costs = COST.findall(path.read_text(encoding="utf-8", errors="replace"))
        if not costs:
            continue
        name = path.relative_to(logs).parts[0].removesuffix(".log")
        wall, cpu, memory = map(float, costs[-1])
        line = found[name]
        line["jobs"] += 1
        line["wall"] += wall
        line["cpu"] += cpu
        line["memory"] = max(line["memory"], memory)
    total = {"name": "all", "jobs": sum(v["jobs"] for v in found.values())}
    total |= {"wall": sum(v["wall"] for v in found.values()), "cpu": sum(v["cpu"] for v in found.values())}
    total["memory"] = max((v["memory"] for v in found.values()), default=0.0)
    lines = [{"name": name, **value} for name, value in found.items()] + [total]
    return [
        line | {"wall": f"{line['wall']:.0f}", "cpu": f"{line['cpu']:.0f}", "memory": f"{line['memory']:.0f}"}
        for line in lines
    ]


def _provenance(estimates: dict, files: Mapping[str, str]) -> list[tuple[str, str]]:
    given = estimates["provenance"]
    lines = [(key, json.dumps(value) if isinstance(value, dict) else str(value)) for key, value in given.items()]
    return lines + [(f"SHA-256 of {Path(path).name}", provenance.checksum(path)) for path in files.values()]
