"""A folder of compiled kernels for every version of their sources, which nobody else can write to.

numba recompiles a cached kernel when its own file changes, but not when a file that it inlines does. The folder is
therefore named by the content of every source file that uses numba. numba runs what it finds there: a folder that
another user owns or may write to is never taken.
"""

import hashlib
import os
import sys
from pathlib import Path

from coronaryuq.core.private_folders import candidates, is_private, is_safe

VARIABLE = "NUMBA_CACHE_DIR"


def choose_folder(package: Path = Path(__file__).parents[1]) -> None:
    """Set numba's cache folder for this version of the kernels in `package`, unless the user has set a safe one.

    It is in the user's cache folder or, if that cannot be written or others can write to it, in a private folder of
    the temporary one.
    """
    named = os.environ.get(VARIABLE)
    if named and (not os.path.lexists(named) or is_safe(Path(named).resolve())):
        return
    if named:
        print(f"note: {VARIABLE} = {named} is not used: others can write to it, or it is not yours", file=sys.stderr)
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        if b"numba" in content:
            digest.update(path.relative_to(package).as_posix().encode() + content)
    os.environ.pop(VARIABLE, None)
    for home in candidates():
        folder = home / f"kernels-{digest.hexdigest()[:16]}"
        if is_private(folder):
            os.environ[VARIABLE] = str(folder)
            return
