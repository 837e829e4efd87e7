"""Threads that march groups of samples, so many for all runs of a process together."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache


@cache
def workers(threads: int) -> ThreadPoolExecutor:
    """One pool of so many threads: runs made side by side share it, and no more kernels than that are at work."""
    return ThreadPoolExecutor(threads, thread_name_prefix="march")


# A child that is forked has none of its parent's threads.
os.register_at_fork(after_in_child=workers.cache_clear)
