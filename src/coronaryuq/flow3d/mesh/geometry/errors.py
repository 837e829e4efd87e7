"""What went wrong in meshing, in one line."""


class MeshError(RuntimeError):
    """A piece could not be meshed; the message says at which step and why."""
