"""Folders that only this user can write to, also without a home, or with one that takes no files."""

import getpass
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

NAME = "coronaryuq"


def is_safe(folder: Path) -> bool:
    """Return whether this user or root owns a folder, and nobody else can write to it."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid in (0, os.geteuid()) and not found.st_mode & 0o022


def is_private(folder: Path, tighten: bool = False) -> bool:
    """Make a folder that only this user can write to; return whether it is one, and takes files.

    tighten: take the write permission of others from an existing folder of this user.
    """
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if tighten and folder.lstat().st_uid == os.geteuid() and not is_safe(folder) and not folder.is_symlink():
            folder.chmod(0o700)
        return is_safe(folder) and folder.lstat().st_uid == os.geteuid() and takes_files(folder)
    except OSError:
        return False


def candidates() -> Iterator[Path]:
    """Yield private folders for what may be lost: in the user's cache folder, else in the temporary one."""
    if (cache := user_cache()) and is_private(cache / NAME, tighten=True):
        yield cache / NAME
    yield from (folder for folder in _in_temporary() if is_private(folder))


def user_cache() -> Path | None:
    """Return the user's cache folder, made if need be.

    None without a home, if it takes no files, or if others could replace what is in it.
    """
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        if not cache.is_absolute():
            return None
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = cache.stat()
        replaceable = found.st_mode & 0o022 and not found.st_mode & stat.S_ISVTX
        own = found.st_uid in (0, os.geteuid()) and not replaceable
        return cache if own and takes_files(cache) else None
    except (OSError, RuntimeError):  # no home at all
        return None


def complete_environment() -> None:
    """Give this process, and those that it starts, a user's name and a home whose cache takes files.

    A container or a service may have neither; other programs stop without them, Snakemake among them.
    """
    try:
        getpass.getuser()
    except (KeyError, OSError):
        os.environ["USER"] = str(os.getuid())
    try:
        known = Path.home().is_absolute()
    except RuntimeError:
        known = False
    if known and user_cache():
        return
    home = next(candidates(), None)
    if home is not None:
        os.environ["XDG_CACHE_HOME"] = str(home / "cache")
        if not known:
            os.environ["HOME"] = str(home)


def _in_temporary() -> Iterator[Path]:
    """Yield folders of this user in the temporary folder, at last a new one."""
    try:
        shared, own = Path(tempfile.gettempdir()), f"{NAME}-{os.geteuid()}"
        yield shared / own
        yield from sorted(shared.glob(f"{own}-*"))
        yield Path(tempfile.mkdtemp(prefix=f"{own}-"))
    except OSError:
        return


def takes_files(folder: str | Path) -> bool:
    """Return whether a file can be made; permissions do not tell on a read-only file system."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
