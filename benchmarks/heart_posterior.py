"""Do the latent coordinates of the tuned heart have the spread of the full posterior of all its free parameters?

Markov chains sample the posterior that `calibration.heart_posterior` approximates, without its approximations: every
state is a run of the loop at rest, which is compared with what was measured, and one under hyperaemia, which says what
the coronary arteries see. Priors and errors are the code's. Proposals are those of preconditioned Crank-Nicolson about
a normal distribution somewhat wider than the Gauss-Newton posterior, from which the chains start.

What the arteries see is then compared with that of hearts drawn from the Gauss-Newton posterior of all parameters,
which says what the linearisation costs, and from the latent coordinates of the campaign's network. Means are geometric,
standard deviations those of the logarithm, in per cent. Every number has the standard error of a jackknife over chains.

FOLDER has the results of a campaign with `uncertainty: full` up to calibration. At smoke size:

    snakemake -s workflow/Snakefile --configfile config/smoke.yaml --config uncertainty=full \\
        -- results/smoke/calibration/hyperaemia.json
    python benchmarks/heart_posterior.py results/smoke
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from coronaryuq.calibration import parameters
from coronaryuq.calibration.heart_posterior import (
    FREE,
    HeartModel,
    HeartPosterior,
    Normal,
    heart_posterior,
    prior_about,
)
from coronaryuq.calibration.hyperaemic_flow import ARTERIAL, VENOUS, hyperaemic_changes
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.targets import PRESSURES, measurement_covariance
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network import parameter_names
from coronaryuq.case.tables.targets import check_targets
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.posterior.sampler.diagnostics import effective_size, split_rhat
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.theta import Theta

SEED = 1
STEPS_PER_CYCLE = 250
"""As calibration's by default."""
KEEP = 0.8
"""Of the distance from the Gauss-Newton mean, what a proposal keeps."""
WIDER = 1.2
"""Standard deviations of the proposals' normal distribution over those of the Gauss-Newton posterior.

Chains stay for long where the posterior reaches further than the proposals."""
DRAWS = 100
"""Of a jackknife's group, where hearts are drawn independently."""
BATCH = 96
"""Runs of the loop at once."""


@dataclass(frozen=True)
class Heart:
    """A tuned heart: its inference, the model at rest and under hyperaemia, data, covariance of errors, and period."""

    found: HeartPosterior
    model: HeartModel
    campaign: HeartModel
    prior: Normal
    data: np.ndarray
    noise: np.ndarray
    period: float

    @property
    def coordinates(self) -> list[str]:
        """Names of the latent coordinates of the campaign's network."""
        names = Theta(self.campaign.loop.network).laws.names
        return [name for name in names if name.startswith(parameter_names.HEART)]


def tuned(folder: Path) -> Heart:
    """Return the heart of a calibrated campaign."""
    case = read_case(folder / "case" / "case.json")
    if case.errors is None:
        raise SystemExit(f"{folder}: the campaign has no `uncertainty: full`")
    targets = check_targets(case.targets, folder / "case" / "case.json")
    rest, stress = (read_network(folder / "calibration" / f"{name}.json") for name in ("rest", "hyperaemia"))
    table = read_csv(folder / "calibration" / "parameters.csv", columns=("name", "value")).set_index("name")["value"]
    searched = np.array([np.log(table[p.name]) if p.logarithmic else table[p.name] for p in parameters.PARAMETERS])
    # The beds' totals are relative to the loop that varies, which here is the tuned one.
    shift = np.where([p.heart is None for p in parameters.PARAMETERS], searched, 0.0)
    point, published = searched - shift, parameters.INITIAL - shift
    # The measured split and hyperaemic flow set these two; nothing is known of them before.
    published[[ARTERIAL, VENOUS]] = point[[ARTERIAL, VENOUS]]
    loop, relaxed = Loop(rest, STEPS_PER_CYCLE), Loop(stress, STEPS_PER_CYCLE)
    fine = rest["simulation_parameters"]["number_of_time_pts_per_cardiac_cycle"] - 1
    at_rest = loop.evaluate(point[None], steps_per_cycle=fine, refill=False)
    extra = hyperaemic_changes(rest, point[None], case.hyperaemia)
    active = loop.evaluate(
        point[None], relaxed.initial_state()[None], steps_per_cycle=fine, extra=extra, refill=False
    )  # fmt: skip
    states = at_rest.state[0], active.state[0]
    found = heart_posterior(loop, point, states, targets, case.hyperaemia, case.errors, fine)
    model = HeartModel(loop, point, states, list(found.relative_sd), case.hyperaemia)
    noise = measurement_covariance(targets, model.measured, case.errors)
    data = np.array([targets[name] for name in model.measured])
    return Heart(
        found, model, HeartModel(relaxed, point, states, (), 1.0), prior_about(published), data, noise, case.period
    )  # fmt: skip


def seen_of(heart: Heart, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what the arteries see (m, q) of hearts, and minus the logarithm of their posterior density (m,)."""
    predicted = heart.model(free, heart.found.steps)
    error, moved = predicted[:, : len(heart.data)] - heart.data, free - heart.prior.mean
    energy = _half_square(error, heart.noise) + _half_square(moved, heart.prior.covariance)
    return predicted[:, len(heart.data) :], np.where(np.isfinite(energy), energy, np.inf)


def _half_square(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return 0.5 * np.einsum("mi,mi->m", x, np.linalg.solve(covariance, x.T).T)


def sample(heart: Heart, chains: int, steps: int) -> dict[str, np.ndarray]:
    """Return chains: states in coordinates of the Gauss-Newton posterior (chains, steps, n), `seen` and `accepted`."""
    root = np.linalg.cholesky(heart.found.posterior.covariance)
    history: list[tuple[np.ndarray, ...]] = []
    z, energy = np.zeros((chains, len(root))), np.full(chains, np.inf)
    seen = np.full((chains, len(heart.model.seen)), np.nan)
    for step in range(steps):
        draw = generator(SEED, "heart posterior", "step", step)
        # A chain draws afresh until it has a periodic state.
        keep = np.where(np.isfinite(energy), KEEP, 0.0)[:, None]
        proposed = keep * z + np.sqrt(1.0 - keep**2) * WIDER * draw.standard_normal(z.shape)
        its_seen, its_energy = seen_of(heart, heart.found.posterior.mean + proposed @ root.T)
        its_energy -= 0.5 * np.einsum("ci,ci->c", proposed, proposed) / WIDER**2
        accepted = its_energy + np.log(draw.uniform(size=chains)) < energy
        z, energy = np.where(accepted[:, None], proposed, z), np.where(accepted, its_energy, energy)
        seen = np.where(accepted[:, None], its_seen, seen)
        history.append((z, seen, accepted))
    return {
        name: np.stack(values, axis=1)
        for name, values in zip(("z", "seen", "accepted"), zip(*history, strict=True), strict=True)
    }


def drawn(shape: tuple[int, int], name: str, size: int, seen: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return what the arteries see (groups, draws, q) of hearts with standard normal coordinates, `size` of them."""
    z = generator(SEED, "heart posterior", name).standard_normal((shape[0] * shape[1], size))
    return np.concatenate([seen(z[k : k + BATCH]) for k in range(0, len(z), BATCH)]).reshape(*shape, -1)


def by_latent(heart: Heart, z: np.ndarray) -> np.ndarray:
    """Return what the arteries see (m, q) at latent coordinates, which change the network as in a campaign."""
    changes = Theta(heart.campaign.loop.network).changes(dict(zip(heart.coordinates, np.exp(z).T, strict=True)))
    return heart.campaign.seen_by_arteries(np.tile(heart.campaign.point, (len(z), 1)), changes, heart.found.steps)


def by_all(heart: Heart, z: np.ndarray) -> np.ndarray:
    """Return what the arteries see (m, q) at coordinates of the whole Gauss-Newton posterior."""
    points = np.tile(heart.model.point, (len(z), 1))
    points[:, FREE] += z @ np.linalg.cholesky(heart.found.posterior.covariance).T
    extra = hyperaemic_changes(heart.model.loop.network, points, heart.model.hyperaemia)
    return heart.model.seen_by_arteries(points, extra, heart.found.steps)


def moments(groups: np.ndarray) -> np.ndarray:
    """Return means and standard deviations (g + 1, 2, q) of draws (g, n, q): of all, then without each group."""
    parts = [groups, *(np.delete(groups, k, axis=0) for k in range(len(groups)))]
    return np.array([(np.nanmean(part, axis=(0, 1)), np.nanstd(part, axis=(0, 1))) for part in parts])


def with_error(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of values (g + 1, q), and the jackknife's standard error by the others."""
    spread = values[1:] - values[1:].mean(axis=0)
    return values[0], np.sqrt((len(spread) - 1) / len(spread) * np.sum(spread**2, axis=0))


def against(full: np.ndarray, other: np.ndarray) -> dict[str, np.ndarray]:
    """Return ratios of standard deviations and differences of means in standard deviations, with errors, (2, q) each.

    full, other: draws (g, n, q) of as many independent groups.
    """
    (mean, sd), (own_mean, own_sd) = moments(full).swapaxes(0, 1), moments(other).swapaxes(0, 1)
    both = {
        "sd_ratio": (own_sd / sd[0], own_sd[0] / sd),
        "mean_difference_in_sds": ((own_mean - mean[0]) / sd[0], (own_mean[0] - mean) / sd),
    }
    return {
        name: np.array([by_other[0], np.hypot(with_error(by_other)[1], with_error(by_full)[1])])
        for name, (by_other, by_full) in both.items()
    }


def report(heart: Heart, history: dict[str, np.ndarray], discard: int) -> dict:
    """Return how the chains went, and every quantity by them, by all Gauss-Newton directions and by the latent ones."""
    z, seen = history["z"][:, discard:], history["seen"][:, discard:]
    half = [part.mean(axis=(0, 1)) for part in np.array_split(seen, 2, axis=1)]
    groups = len(z), DRAWS
    ways = {
        "chains": seen,
        "gauss_newton": drawn(groups, "gauss-newton", z.shape[2], partial(by_all, heart)),
        "latent": drawn(groups, "latent", len(heart.coordinates), partial(by_latent, heart)),
    }
    unit = np.array([1.0 if name in PRESSURES else heart.period * ML_PER_MIN for name in heart.model.seen])
    columns = {}
    for way, draws in ways.items():
        mean, sd = (np.array(with_error(part)) for part in moments(draws).swapaxes(0, 1))
        middle = np.exp(mean[0]) / unit
        columns[way] = {"mean": np.array([middle, middle * mean[1]]), "sd_percent": 100.0 * sd}
        if way != "chains":
            columns[way] |= against(seen, draws)
    return {
        "measured": heart.model.measured, "parameters": z.shape[2], "coordinates": len(heart.coordinates),
        "least_share_of_variance": round(heart.found.captured, 4), "steps_per_cycle": heart.found.steps,
        "chains": len(z), "states_of_each": z.shape[1], "discarded_before": discard,
        "pairs_of_runs": history["accepted"].size,
        "acceptance": round(float(history["accepted"][:, discard:].mean()), 3),
        "rhat_of_parameters": round(float(split_rhat(z).max()), 4),
        "rhat_of_quantities": round(float(split_rhat(seen).max()), 4),
        "effective_size_of_quantities": round(float(effective_size(seen, "bulk").min())),
        "halves_differ_in_sds": round(float(np.max(np.abs(half[1] - half[0]) / seen.std(axis=(0, 1)))), 3),
        "without_periodic_state": {way: round(float(np.isnan(x[..., 0]).mean()), 4) for way, x in ways.items()},
        "quantities": {
            name: {
                way: {key: np.round(values[:, q], 3).tolist() for key, values in found.items()}
                for way, found in columns.items()
            }
            for q, name in enumerate(heart.model.seen)
        },
    }  # fmt: skip


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folder", type=Path, help="results of a campaign with `uncertainty: full`")
    options.add_argument("--chains", type=int, default=96)
    options.add_argument("--steps", type=int, default=240, help="states of a chain")
    options.add_argument("--discard", type=int, default=40, help="first states that do not count")
    given = options.parse_args()
    heart = tuned(given.folder)
    found = report(heart, sample(heart, given.chains, given.steps), given.discard)
    rows = found.pop("quantities")
    print(json.dumps(found, indent=1))
    for name, row in rows.items():
        print(json.dumps({"quantity": name} | row))


if __name__ == "__main__":
    main()
