"""One campaign at a time in a results folder: a lock that the system itself drops when its holder dies.

Snakemake's own lock outlives a killed process and then wants `--unlock` typed by hand; the profiles switch it off.
"""

import fcntl
import os
import platform
import sys
from datetime import datetime
from io import TextIOWrapper
from pathlib import Path

from coronaryuq.core.errors import InputError


def occupy(folder: str | Path) -> TextIOWrapper:
    """Take a results folder for this process until it ends; keep what is returned, closing it gives the folder free.

    Raises InputError with the holder's process, machine and start when another campaign has it. Where the file system
    knows no locks, says so on standard error and goes on.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # Opened without truncation: what it says until the lock is taken is about its holder.
    held = open(os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644), "r+", encoding="utf-8")  # noqa: SIM115
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = held.read().strip() or "not known"
        held.close()
        raise InputError(
            folder, None, None, f"another campaign is at work here ({holder}); wait for it, or stop it"
        ) from None
    except OSError as error:
        print(f"{folder}: no locks on this file system ({error.strerror}); run one campaign at a time", file=sys.stderr)
        return held
    held.truncate()
    held.write(f"process {os.getpid()} on {platform.node()}, since {datetime.now().isoformat(' ', 'seconds')}\n")
    held.flush()
    return held
