"""Physical effects that a 0D model may lack: one class per effect, one file each."""
