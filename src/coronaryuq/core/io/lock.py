"""One campaign at a time in a results folder: a lock that the operating system drops when its holder dies.

Snakemake's own lock outlives a killed process and then needs a manual `--unlock`; the profiles switch it off.
"""

import os
import platform
import sys
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from coronaryuq.core.errors import InputError


def lock_results(folder: str | Path) -> AbstractContextManager:
    """Lock a results folder until this process ends or the returned context is left.

    On a file system without locks, prints a warning and continues.

    Raises
    ------
    InputError
        If another campaign holds the lock; names its process, machine and start.
    """
    path = Path(folder, ".lock")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        lock = FileLock(path, timeout=0, fallback_to_soft=False, preserve_lock_file=True).acquire()
    except Timeout:
        holder = path.read_text(encoding="utf-8").strip() or "unknown"
        raise InputError(
            folder, None, None, f"another campaign is running here ({holder}); wait for it, or stop it"
        ) from None
    except (OSError, NotImplementedError) as error:
        print(f"{folder}: this file system has no locks ({error}); run only one campaign at a time", file=sys.stderr)
        return nullcontext()
    since = datetime.now().isoformat(" ", "seconds")
    path.write_text(f"process {os.getpid()} on {platform.node()}, since {since}\n", encoding="utf-8")
    return lock
