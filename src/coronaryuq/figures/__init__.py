"""Figures, drawn from result files only."""

import logging
import os

# A notebook and a desktop name a backend that need not be installed here, and a home may take no files; both before
# Matplotlib is imported, which refuses an unknown backend and speaks of its own folders.
os.environ["MPLBACKEND"] = "agg"
logging.getLogger("matplotlib").setLevel(logging.ERROR)
