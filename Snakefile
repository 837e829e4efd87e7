# One patient, from anatomy and noisy perfusion to quantities of interest with confidence intervals.
#
#   snakemake --profile workflow/profiles/default --configfile config/laptop.yaml            the whole campaign
#   snakemake figures --profile workflow/profiles/default --configfile config/laptop.yaml    its figures alone
#   snakemake paper_table --profile workflow/profiles/default --configfile config/laptop.yaml
#   snakemake mesh_study --profile workflow/profiles/default --configfile config/laptop.yaml   error of its mesh
#   snakemake paper_figures ...   figures 3, 4, 5 and 7 of the published runs, with paper_table
#   snakemake paper_convergence_figure ...   their convergence study;   snakemake coverage ...   coverage of the intervals
#   snakemake discrepancy --profile workflow/profiles/default --configfile config/laptop.yaml  what the model lacks
#   snakemake discrepancy_benchmark ...   how often the search for it is right

from snakemake.utils import min_version

min_version("9.27")


include: "workflow/rules/common.smk"
include: "workflow/rules/patient.smk"
include: "workflow/rules/perfusion.smk"
include: "workflow/rules/calibration.smk"
include: "workflow/rules/posterior.smk"
include: "workflow/rules/flow3d.smk"
include: "workflow/rules/zerod.smk"
include: "workflow/rules/estimation.smk"
include: "workflow/rules/discrepancy.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/paper.smk"


localrules:
    all,
    figures,
    coverage,
    discrepancy,
    paper_figures,


rule all:
    default_target: True
    input:
        report=results("report.html"),
        table=results("estimation", "table.csv"),
