"""The answer: tables, text, the repaired network."""
