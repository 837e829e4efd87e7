"""Units, seeds, errors, records and files: the base of every other package."""
