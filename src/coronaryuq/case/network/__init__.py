"""The 0D network of a case: built from the anatomy, or read from a file."""
