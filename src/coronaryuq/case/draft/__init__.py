"""A first description of a patient from an anatomy alone: what can be read off it, and blanks for the rest."""
