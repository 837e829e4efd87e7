"""The models of a campaign by the UM-Bridge protocol."""
