"""The methods of a campaign as a paragraph to paste into a paper, with its references in BibTeX."""

from collections.abc import Mapping

from coronaryuq.case.case_json import CaseSummary
from coronaryuq.posterior.results import Summary

REFERENCES = """\
@article{menon2025personalized,
  author  = {Menon, Karthik and Zanoni, Andrea and Khan, Owais and Geraci, Gianluca and Nieman, Koen and Schiavazzi, Daniele E. and Marsden, Alison L.},
  title   = {Personalized and uncertainty-aware coronary hemodynamics simulations: From {Bayesian} estimation to improved multi-fidelity uncertainty quantification},
  journal = {Computer Methods and Programs in Biomedicine},
  volume  = {271},
  pages   = {108951},
  year    = {2025}
}

@article{vrugt2009accelerating,
  author  = {Vrugt, Jasper A. and ter Braak, Cajo J. F. and Diks, Cees G. H. and Robinson, Bruce A. and Hyman, James M. and Higdon, Dave},
  title   = {Accelerating {Markov} chain {Monte Carlo} simulation by differential evolution with self-adaptive randomized subspace sampling},
  journal = {International Journal of Nonlinear Sciences and Numerical Simulation},
  volume  = {10},
  number  = {3},
  pages   = {273--290},
  year    = {2009}
}

@article{vehtari2021rank,
  author  = {Vehtari, Aki and Gelman, Andrew and Simpson, Daniel and Carpenter, Bob and B{\\"u}rkner, Paul-Christian},
  title   = {Rank-normalization, folding, and localization: An improved {$\\widehat{R}$} for assessing convergence of {MCMC}},
  journal = {Bayesian Analysis},
  volume  = {16},
  number  = {2},
  pages   = {667--718},
  year    = {2021}
}

@article{owen2017shapley,
  author  = {Owen, Art B. and Prieur, Cl{\\'e}mentine},
  title   = {On {Shapley} value for measuring importance of dependent inputs},
  journal = {SIAM/ASA Journal on Uncertainty Quantification},
  volume  = {5},
  number  = {1},
  pages   = {986--1002},
  year    = {2017}
}
"""  # noqa: E501
SOLVERS = {
    "ensemble": "the ensemble finite-element solver of coronaryuq",
    "svsolver": "svSolver",
    "svmultiphysics": "svMultiPhysics",
    "umbridge": "a model on an UM-Bridge server",
}


def paragraph(
    case: CaseSummary, configuration: Mapping, counts: Mapping, summary: Summary, nodes: int, stamp: Mapping
) -> str:
    """Return the methods of this campaign in plain text, with its numbers and versions.

    Parameters
    ----------
    case
        The case.
    configuration
        The campaign's configuration.
    counts
        Numbers of runs, as the page has them.
    summary
        `posterior/summary.json`.
    nodes
        Of the 3D mesh.
    stamp
        Provenance of the estimates.
    """
    samples, level = configuration["samples"], configuration["estimation"]["level"]
    lesions = ", ".join(stenosis.name for stenosis in case.stenoses)
    steps = f"{summary.chains} chains, largest R-hat {summary.rhat_max:.3f}, smallest bulk effective sample size "
    steps += f"{summary.ess_bulk_min:.0f} [vehtari2021rank]"
    libraries = ", ".join(f"{name} {version}" for name, version in dict(stamp.get("libraries", {})).items())
    return (
        f"Haemodynamics in hyperaemia were computed with coronaryuq {stamp.get('code', '')} by the method of Menon et "
        f"al. [menon2025personalized]. A closed-loop lumped-parameter model with {len(case.outlets)} coronary outlets "
        f"was tuned to the clinical measurements; the resistances of the {len(case.lv_outlets)} outlets that perfuse "
        f"the left ventricle were inferred from myocardial perfusion by DREAM [vrugt2009accelerating] ({steps}). "
        f"{counts['n_3d_ok']} three-dimensional simulations by {SOLVERS.get(configuration['backend'])} on a mesh of "
        f"{nodes:,} nodes and {counts['n_0d']} zero-dimensional simulations, of which {samples['n_0d']:,} or more "
        f"propagate the posterior, were combined by cross-fitted multi-fidelity estimators; intervals have a nominal "
        f"level of {100 * level:.0f} %. Lesions: {lesions}. Contributions of the inputs to the variance are Shapley "
        f"effects [owen2017shapley]. Seed {configuration['seed']}; Python {stamp.get('python', '')}, {libraries}."
    )


def software(stamp: Mapping) -> str:
    """Return the BibTeX entry of this version of the package."""
    version = str(stamp.get("code", "")).split(" ")[0]
    return (
        "@software{coronaryuq,\n  author  = {{The coronaryuq authors}},\n"
        "  title   = {coronaryuq: personalised coronary haemodynamics with calibrated error bars},\n"
        f"  version = {{{version}}},\n  year    = {{2026}}\n}}\n"
    )
