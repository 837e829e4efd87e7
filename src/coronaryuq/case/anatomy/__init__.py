"""The centreline tree, read from any of the formats of a case, and its stenoses."""
