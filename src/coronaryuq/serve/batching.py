"""Batches of requests that arrive at the same time, as many as a model has lanes."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from coronaryuq.serve.models import ServedModel

WINDOW = 0.005
"""Seconds to wait for further requests after the first."""

Request = tuple[list[float], "asyncio.Future[list[float] | str]"]


class Batcher:
    """A queue of requests for one model, which a separate thread runs in batches."""

    def __init__(self, model: ServedModel, window: float = WINDOW):
        self.model, self.window = model, window
        self.batches: list[int] = []
        self._queue: asyncio.Queue[Request] = asyncio.Queue()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=model.name)

    async def ask(self, theta: list[float]) -> list[float] | str:
        """Return the outputs at θ, or the reason for their absence."""
        answer = asyncio.get_running_loop().create_future()
        self._queue.put_nowait((theta, answer))
        return await answer

    async def work(self) -> None:
        """Run batches until cancelled."""
        try:
            while True:
                await self._run(await self._next())
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    async def _next(self) -> list[Request]:
        requests = [await self._queue.get()]
        try:
            async with asyncio.timeout(self.window):
                while len(requests) < self.model.lanes:
                    requests.append(await self._queue.get())
        except TimeoutError:
            pass
        return requests

    async def _run(self, requests: list[Request]) -> None:
        requests = [request for request in requests if not request[1].done()]  # a client may have disconnected
        if not requests:
            return
        self.batches.append(len(requests))
        theta = np.array([theta for theta, _ in requests])
        try:
            answers = await asyncio.get_running_loop().run_in_executor(self._thread, self.model.run, theta)
        except Exception as error:  # of any kind: it is returned to these requests, and the server continues
            answers = [" ".join(f"{type(error).__name__}: {error}".split())] * len(requests)
        for (_, answer), value in zip(requests, answers, strict=True):
            if not answer.done():
                answer.set_result(value)
