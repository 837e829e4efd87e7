"""Posterior of the outlet resistances with tinyDA as the client of `coronaryuq serve`.

    coronaryuq serve results/smoke                                              in one terminal
    python examples/tinyda_posterior.py http://127.0.0.1:4242 results/smoke     in another

The prior of every multiplier is lognormal, the likelihood that of the campaign's target flows. The campaign's own
sampler conditions on the total resistance and has a uniform prior, so that the two posteriors differ a little.
"""

import argparse

import numpy as np
import requests
import scipy.stats
import tinyDA
import umbridge

from coronaryuq.case.case_json import read_case
from coronaryuq.perfusion.targets import read_perfusion_targets


def main() -> None:
    parser = argparse.ArgumentParser(description="Posterior of the outlet resistances with tinyDA.")
    parser.add_argument("url", help="address of the server")
    parser.add_argument("campaign", help="results folder of the campaign that is served")
    parser.add_argument("--iterations", type=int, default=500, help="of the chain (default 500)")
    options = parser.parse_args()

    info = requests.post(f"{options.url}/ModelInfo", json={"name": "zerod"}, timeout=60).json()
    targets = read_perfusion_targets(f"{options.campaign}/perfusion/targets.json")
    vessels = {outlet.bc: outlet.vessel for outlet in read_case(f"{options.campaign}/case/case.json").outlets}
    flows = [info["outputNames"].index(f"mean_flow:{vessels[bed]}:{bed}") for bed in targets.bc]
    order = [targets.bc.index(bed) for bed in info["inputNames"][:-1]]

    def theta(x: np.ndarray) -> np.ndarray:
        """Multipliers from their logarithms, in the server's order, and a scaling of 1."""
        return np.append(np.exp(x)[order], 1.0)

    served = tinyDA.UmBridgeModel(umbridge.HTTPModel(options.url, "zerod"), pre=theta)
    count = len(targets.bc)
    prior = scipy.stats.multivariate_normal(np.zeros(count), 0.3**2 * np.eye(count))
    likelihood = tinyDA.GaussianLogLike(targets.mean, targets.covariance)
    posterior = tinyDA.Posterior(prior, likelihood, lambda x: served(x)[flows])
    proposal = tinyDA.AdaptiveMetropolis(C0=0.05**2 * np.eye(count), period=50)
    chains = tinyDA.sample(posterior, proposal, iterations=options.iterations, n_chains=1, force_sequential=True)
    multipliers = np.exp([link.parameters for link in chains["chain_0"]][options.iterations // 4 :])
    for bed, mean, sd in zip(targets.bc, multipliers.mean(axis=0), multipliers.std(axis=0), strict=True):
        print(f"{bed}: multiplier of r-hat {mean:.3f} ± {sd:.3f}")


if __name__ == "__main__":
    main()
