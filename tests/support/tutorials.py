"""The tutorials' commands, run as a reader runs them."""

import os
import re
import subprocess
import sys
from pathlib import Path

from support.checkout import ROOT

FOLDER = ROOT / "docs" / "tutorials"
BLOCK = re.compile(r"(<!-- long -->\n)?```bash\n(.*?)```", re.DOTALL)


def follow(page: str, folder: Path, long: bool = False) -> str:
    """Run the blocks of a page in a folder, in order; return what they printed.

    long: also those that take minutes, which the page marks.
    """
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    printed = ""
    for slow, block in BLOCK.findall((FOLDER / page).read_text(encoding="utf-8")):
        if slow and not long:
            continue
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block], cwd=folder, env=environment,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=3000,
        )  # fmt: skip
        assert done.returncode == 0, f"{block}\n{done.stdout}"
        printed += done.stdout
    return printed
