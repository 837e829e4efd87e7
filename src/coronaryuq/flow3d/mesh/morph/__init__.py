"""One topology, many lumens: the nodes of a mesh moved to a drawn lumen."""
