"""The command `coronaryuq serve`: the models of a campaign by the UM-Bridge protocol."""

import argparse
import asyncio
import errno
import importlib.util
import os

from coronaryuq.core.command_line import non_negative_int
from coronaryuq.core.errors import InputError

LOOPBACK = ("127.0.0.1", "localhost", "::1")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq serve` to `parser`."""
    parser.description = (
        "Serve the models zerod, loglikelihood, flow3d and flow3d_coarse of a campaign by the UM-Bridge protocol. "
        "Requests that arrive at the same time are run as one batch."
    )
    parser.add_argument("campaign", metavar="CAMPAIGN", help="results folder of a campaign, results/NAME")
    parser.add_argument("--port", type=non_negative_int, default=4242, help="port; 0: a free one (default: 4242)")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: 127.0.0.1: this machine only)"
    )


def main(options: argparse.Namespace) -> int:
    """Serve until interrupted.

    Raises
    ------
    InputError
        If the folder is not a campaign's, if it has no model yet, if the package umbridge is missing, or if the
        address cannot be used.
    """
    if importlib.util.find_spec("aiohttp") is None:
        raise InputError("serve", None, None, "needs the package umbridge: pip install 'coronaryuq[umbridge]'")
    from coronaryuq.serve.models import models_of
    from coronaryuq.serve.server import serve

    models, missing = models_of(options.campaign)
    for error in missing:
        print(f"not served: {error}", flush=True)
    if not models:
        raise missing[0]
    if options.host not in LOOPBACK:
        print(f"note: whoever reaches {options.host} can run these models; there is no password", flush=True)

    def ready(address: str) -> None:
        for model in models:
            print(
                f"{model.name}: {len(model.inputs)} inputs, {len(model.outputs)} outputs, up to {model.lanes} at once"
            )
        print(f"serving {options.campaign} at {address}; stop with Ctrl-C", flush=True)

    try:
        asyncio.run(serve(models, options.host, options.port, ready))
    except OSError as error:
        if error.errno not in (errno.EADDRINUSE, errno.EADDRNOTAVAIL, errno.EACCES):
            raise
        place = f"{options.host}:{options.port}"
        raise InputError("serve", "--port", place, f"{os.strerror(error.errno).lower()}; choose another") from None
    return 0
