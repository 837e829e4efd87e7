"""Threads that advance groups of samples, shared by all runs of a process."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache


@cache
def thread_pool(threads: int) -> ThreadPoolExecutor:
    """Return the pool of `threads` threads; concurrent runs share it, which limits the kernels at work."""
    return ThreadPoolExecutor(threads, thread_name_prefix="march")


# A forked child process has none of its parent's threads.
os.register_at_fork(after_in_child=thread_pool.cache_clear)
