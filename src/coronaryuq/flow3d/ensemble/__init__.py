"""The ensemble solver: many samples on one mesh, coupled to their 0D networks."""
