"""Results: tables, text, the repaired network."""
