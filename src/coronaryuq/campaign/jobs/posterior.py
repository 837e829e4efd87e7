"""Make chains, gather them (posterior, convergence, predictive checks), and draw samples of them."""

from coronaryuq.core.ranks import Ranks
from coronaryuq.estimation.results import read_round
from coronaryuq.posterior.samples import FIRST
from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import Extent, GatheredFiles, draw_samples, gather, sample


def make_chains(
    case_json: str, hyperaemia_json: str, targets_json: str, settings: Settings, seed: int, length: int, out_npz: str,
    ranks: Ranks, before: str | None = None,
) -> None:  # fmt: skip
    """Make chains of some length, over that which the settings give, from shorter ones if these are given."""
    extent = Extent(length, before)
    sample(case_json, hyperaemia_json, targets_json, settings, seed, out_npz, ranks, extent)


def gather_chains(
    case_json: str, hyperaemia_json: str, targets_json: str, chains_npz: str, settings: Settings, seed: int,
    posterior: str, draws: str, summary: str, fractions: str, fitted: str,
) -> None:  # fmt: skip
    """Convert chains to draws, a summary with a convergence verdict, and the fitted network."""
    files = GatheredFiles(posterior, draws, summary, fractions, fitted)
    gather(case_json, hyperaemia_json, targets_json, chains_npz, settings, seed, files)


def draw_set(
    draws_csv: str, settings: Settings, seed: int, name: str, number: int, out_csv: str, allocation: str | None = None
) -> None:
    """Draw `number` samples of one set, or the propagation samples of the last round of a growing campaign."""
    counts = read_round(allocation).counts if allocation else None
    lengths, number = (counts.lengths, counts.n_0d) if counts else (FIRST, number)
    draw_samples(draws_csv, settings, seed, name, number, out_csv, lengths)
