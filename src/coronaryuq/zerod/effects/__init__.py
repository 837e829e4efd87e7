"""Physical effects that a 0D model may be missing: one class per effect, one file each."""
