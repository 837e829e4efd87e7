"""Tables of model runs: gathered from a campaign, or published."""
