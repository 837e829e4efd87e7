"""Validation of RO-Crates by roc-validator, without a network."""

import shutil
import subprocess
from pathlib import Path

PROGRAM = "rocrate-validator"
CONTEXT = Path(__file__).with_name("ro-crate-1.1-context.json")
"""The context of RO-Crate 1.1 (CC0), which a crate names by its address."""
FILL_CACHE = """
import io, sys
import requests, urllib3
from requests_cache import CachedSession

class FromFile(requests.adapters.HTTPAdapter):
    def send(self, request, **options):
        headers = {"Content-Type": "application/ld+json"}
        body = io.BytesIO(open(sys.argv[2], "rb").read())
        found = urllib3.HTTPResponse(body=body, headers=headers, status=200, preload_content=False)
        return self.build_response(request, found)

session = CachedSession(cache_name=sys.argv[1], expire_after=-1, backend="sqlite", allowable_methods=("GET",))
session.mount("https://w3id.org/", FromFile())
session.get("https://w3id.org/ro/crate/1.1/context").raise_for_status()
"""
"""Puts the context into the cache from which the validator reads when it is offline."""


def validate(crate: Path, profile: str, folder: Path, severity: str = "required") -> subprocess.CompletedProcess:
    """Validate a crate against a profile of the validator; `folder` is for its cache."""
    program = Path(shutil.which(PROGRAM)).resolve()
    python = program.with_name("python")
    cache = folder / "validator-cache"
    subprocess.run([python, "-c", FILL_CACHE, cache, CONTEXT], check=True)
    return subprocess.run(
        [program, "-y", "--disable-color", "validate", crate, "--profile-identifier", profile, "--offline",
         "--cache-path", cache, "--requirement-severity", severity, "--verbose", "--no-paging"],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
