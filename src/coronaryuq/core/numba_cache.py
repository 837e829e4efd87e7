"""A folder of compiled kernels for every version of their sources.

numba recompiles a cached kernel when its own file changes, but not when a file that it inlines does. The folder is
therefore named by the content of every source file that uses numba.
"""

import hashlib
import os
import tempfile
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"


def choose_folder(package: Path = Path(__file__).parents[1]) -> None:
    """Set numba's cache folder for this version of the kernels in `package`, unless the user has set one.

    It is in the user's cache folder or, if that is not writable, in the temporary folder.
    """
    if os.environ.get(VARIABLE):
        return
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        if b"numba" in content:
            digest.update(path.relative_to(package).as_posix().encode() + content)
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for base in (home, Path(tempfile.gettempdir())):
        folder = base / "coronaryuq" / f"kernels-{digest.hexdigest()[:16]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            os.environ[VARIABLE] = str(folder)
            return
