"""Gather the chains: posterior, draws, convergence, predictive checks."""

from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import GatheredFiles, gather


def gather_chains(
    case_json: str, hyperaemia_json: str, targets_json: str, chains_npz: str, settings: Settings, seed: int,
    posterior: str, draws: str, summary: str, fractions: str, fitted: str,
) -> None:  # fmt: skip
    """Convert chains to draws, a summary with a convergence verdict, and the fitted network."""
    files = GatheredFiles(posterior, draws, summary, fractions, fitted)
    gather(case_json, hyperaemia_json, targets_json, chains_npz, settings, seed, files)
