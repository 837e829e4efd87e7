"""The UM-Bridge protocol, version 1.0, over HTTP: https://um-bridge-benchmarks.readthedocs.io.

umbridge's own server runs one request at a time and listens on all addresses; this one batches them and listens on a
given address. In addition to the protocol, `ModelInfo` names the components: `inputNames`, `outputNames`.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any

from aiohttp import web

from coronaryuq.core.io.text import parse_json
from coronaryuq.serve.batching import Batcher
from coronaryuq.serve.models import ServedModel


class Refused(Exception):
    """An invalid request: the kind of its error in the protocol, and one line."""

    def __init__(self, kind: str, line: str, status: int = 400):
        super().__init__(line)
        self.kind, self.status = kind, status


def application(models: Sequence[ServedModel]) -> web.Application:
    """Return the web application that serves the models."""
    batchers = {model.name: Batcher(model) for model in models}
    app = web.Application()
    app.cleanup_ctx.append(_workers(list(batchers.values())))

    def posted(path: str, answer: Callable[[Batcher, dict[str, Any]], Any]) -> None:
        async def handle(request: web.Request) -> web.Response:
            try:
                batcher, body = _asked(batchers, await request.text())
                return web.json_response(await answer(batcher, body))
            except Refused as refused:
                error = {"type": refused.kind, "message": str(refused)}
                return web.json_response({"error": error}, status=refused.status)

        app.router.add_post(path, handle)

    async def info(request: web.Request) -> web.Response:
        return web.json_response({"protocolVersion": 1.0, "models": list(batchers)})

    app.router.add_get("/Info", info)
    posted("/ModelInfo", _model_info)
    posted("/InputSizes", _input_sizes)
    posted("/OutputSizes", _output_sizes)
    posted("/Evaluate", _evaluate)
    for unsupported in ("Gradient", "ApplyJacobian", "ApplyHessian"):
        posted(f"/{unsupported}", _unsupported)
    return app


async def serve(models: Sequence[ServedModel], host: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve models until cancelled.

    Parameters
    ----------
    models
        The models.
    host, port
        Address to listen on; port 0: a free port.
    ready
        Called with the address when the server is ready.
    """
    runner = web.AppRunner(application(models), access_log=None)
    await runner.setup()
    try:
        await web.TCPSite(runner, host, port).start()
        place = runner.addresses[0]
        ready(f"http://{place[0]}:{place[1]}")
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()


def _workers(batchers: Sequence[Batcher]) -> Callable[[web.Application], AsyncIterator[None]]:
    async def context(app: web.Application) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(batcher.work()) for batcher in batchers]
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    return context


def _asked(batchers: dict[str, Batcher], text: str) -> tuple[Batcher, dict[str, Any]]:
    try:
        body = parse_json(text)
    except ValueError as error:
        raise Refused("InvalidInput", f"the request is not JSON ({error})") from None
    if not isinstance(body, dict):
        raise Refused("InvalidInput", "the request is not a JSON object")
    if body.get("name") not in batchers:
        raise Refused("ModelNotFound", f"no model {body.get('name')!r}; served are {', '.join(batchers)}")
    if body.get("config"):
        raise Refused("InvalidInput", f"config = {body['config']!r}: the models have no options; leave it empty")
    return batchers[body["name"]], body


async def _model_info(batcher: Batcher, body: dict[str, Any]) -> dict[str, Any]:
    support = dict.fromkeys(("Gradient", "ApplyJacobian", "ApplyHessian"), False)
    names = {"inputNames": batcher.model.inputs, "outputNames": batcher.model.outputs}
    return {"support": {"Evaluate": True, **support}, **names}


async def _input_sizes(batcher: Batcher, body: dict[str, Any]) -> dict[str, Any]:
    return {"inputSizes": [len(batcher.model.inputs)]}


async def _output_sizes(batcher: Batcher, body: dict[str, Any]) -> dict[str, Any]:
    return {"outputSizes": [len(batcher.model.outputs)]}


async def _unsupported(batcher: Batcher, body: dict[str, Any]) -> dict[str, Any]:
    raise Refused("UnsupportedFeature", f"{batcher.model.name} has no derivatives")


async def _evaluate(batcher: Batcher, body: dict[str, Any]) -> dict[str, Any]:
    answer = await batcher.ask(_theta(batcher.model, body.get("input")))
    if isinstance(answer, str):
        raise Refused("ModelError", answer, status=500)
    return {"output": [answer]}


def _theta(model: ServedModel, given: Any) -> list[float]:
    """Return the one vector of inputs of a request, checked."""
    names = model.inputs
    if not (isinstance(given, list) and len(given) == 1 and isinstance(given[0], list)):
        raise Refused("InvalidInput", f"input: expected one vector of {len(names)} numbers: {', '.join(names)}")
    (theta,) = given
    if len(theta) != len(names):
        raise Refused("InvalidInput", f"input: {len(theta)} numbers in place of {len(names)}: {', '.join(names)}")
    for name, value in zip(names, theta, strict=True):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        signed = name in model.signed
        if not number or not math.isfinite(value) or not (signed or value > 0):
            raise Refused("InvalidInput", f"{name} = {value!r}: expected a {'' if signed else 'positive '}number")
    return [float(value) for value in theta]
