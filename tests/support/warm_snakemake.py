"""Snakemake without its start: one process imports it, and what the workflow imports, and forks for every run.

A test asks for a plan in a fraction of the time that a process of its own takes. The fork has the environment, the
folder and the streams of its own that a process would have; its `coronaryuq` is that of this checkout.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
TIMEOUT = 1200


@cache
def _server() -> subprocess.Popen:
    server = subprocess.Popen(
        [sys.executable, __file__], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    atexit.register(server.wait)
    atexit.register(server.stdin.close)  # is called first, and ends it
    return server


def snakemake(arguments: list[str], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess:
    """Run Snakemake with these arguments in a folder."""
    server = _server()
    with tempfile.TemporaryDirectory() as told:
        request = {"arguments": arguments, "folder": str(folder), "environment": environment, "told": told}
        server.stdin.write(json.dumps(request) + "\n")
        server.stdin.flush()
        code = int(server.stdout.readline())
        out, err = (Path(told, name).read_text() for name in ("out", "err"))
    return subprocess.CompletedProcess(arguments, code, out, err)


def _serve() -> None:
    from importlib import import_module

    import snakemake.cli

    import coronaryuq
    from coronaryuq.core import provenance

    for name in ("smart_open", *_imports_of_the_workflow()):
        import_module(name)
    snakemake.cli.get_argument_parser()  # imports the plug-ins
    # What they return is kept, for code_digest.
    provenance.closure("coronaryuq.cli.main")
    for path in Path(coronaryuq.__file__).parent.rglob("*.py"):
        provenance.syntax_digest(path)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _run(**json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _imports_of_the_workflow() -> list[str]:
    lines = (ROOT / "workflow" / "rules" / "common.smk").read_text().splitlines()
    imported = [line.split()[1] for line in lines if line.startswith("from coronaryuq")]
    assert imported
    return imported


def _run(arguments: list[str], folder: str, environment: dict[str, str], told: str) -> None:
    """Become that run of Snakemake; never return."""
    code = 1
    try:
        signal.alarm(TIMEOUT)
        os.setpgid(0, 0)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for stream, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(Path(told, name), os.O_WRONLY | os.O_CREAT), stream)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        sys.argv = ["snakemake", *arguments]
        from snakemake.cli import main

        main(arguments)
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    _serve()
