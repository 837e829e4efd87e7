"""The patient: reading, checking and completing a case."""
