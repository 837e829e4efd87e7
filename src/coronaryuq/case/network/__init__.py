"""The 0D network of an anatomy, or one that is given."""
