"""Where a mesh cuts the 0D network, and what of the network is left."""
