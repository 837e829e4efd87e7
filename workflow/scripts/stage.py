"""Run the function of a job with the files and parameters of its rule as keywords; see coronaryuq.campaign.job.

A rule names the function in `params.function`, as MODULE:FUNCTION. To run it manually:

    python workflow/scripts/stage.py --params '{"function": "coronaryuq.case.stage:prepare_case", "settings": {}}' \
        --input case_yaml=PATH --output case_json=DIR/case.json
"""

from coronaryuq.campaign.job import job

with job(globals()) as this:
    this.call()
