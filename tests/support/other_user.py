"""Commands run as a user who has no entry in the password file."""

import os
import shutil

import pytest

READ_ALL = ("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")
"""Such a user could not read an interpreter in root's home; it may read every file, and write no more than others."""


def as_user(uid: int) -> list[str]:
    """Return the beginning of a command line that runs the rest as this user; skip the test where that needs root."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("needs root and setpriv to become another user")
    return ["setpriv", "--reuid", str(uid), "--regid", str(uid), "--clear-groups", *READ_ALL]
