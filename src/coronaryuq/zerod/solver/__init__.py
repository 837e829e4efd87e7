"""The 0D solver: assembly, elimination, time steps of many parameter sets at once, periodic states."""
