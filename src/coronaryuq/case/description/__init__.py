"""The case file, `case.yaml`: its fields and the files that it refers to."""
