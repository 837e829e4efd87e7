"""numba with its cache folder set; modules with kernels import numba from here.

The folder has to be known when a kernel is decorated, and finding it reads every source file with kernels: no work for
a bare `import coronaryuq`.
"""

import os

import numba
from numba import njit

from coronaryuq.core import numba_cache

__all__ = ["njit", "numba"]

numba_cache.choose_folder()
# numba read the variable when it was imported.
setattr(numba.config, "CACHE_DIR", os.environ.get(numba_cache.VARIABLE, ""))  # noqa: B010
