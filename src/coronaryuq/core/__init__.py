"""Units, seeds, errors, records and files: what every other package builds on."""
