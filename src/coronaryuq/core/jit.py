"""numba with its cache folder set; modules with kernels import its decorators from here.

The folder has to be known when a kernel is decorated, and finding it reads every source file with kernels: no work for
a bare `import coronaryuq`.
"""

import os
import warnings
from functools import partial
from typing import Any

import numba

from coronaryuq.core import numba_cache

njit: Any = partial(numba.njit, no_cfunc_wrapper=True)
"""`numba.njit` without the entry for C callbacks, which nobody calls here and which takes long to compile."""
njit_inner: Any = partial(njit, no_cpython_wrapper=True)
"""`njit` for kernels that only other kernels call: without the entry for Python."""

# What numba remarks on is for programmers, who see it when they run the tests of a kernel.
warnings.filterwarnings("ignore", category=numba.NumbaWarning)
numba_cache.choose_folder()
# numba read the variable when it was imported.
setattr(numba.config, "CACHE_DIR", os.environ.get(numba_cache.VARIABLE, ""))  # noqa: B010
