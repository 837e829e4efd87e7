"""Requests that arrive together are run together, in no more lanes than the model has."""

import asyncio

import numpy as np
import pytest

from coronaryuq.serve.batching import Batcher

pytest.importorskip("aiohttp", reason="needs aiohttp, which is not installed")


class Doubling:
    """Doubles its input; an input of 13 breaks the whole batch."""

    name, inputs, outputs, lanes, signed = "doubling", ["x"], ["y"], 4, []

    def run(self, theta: np.ndarray) -> list[list[float] | str]:
        if (theta == 13).any():
            raise ZeroDivisionError("thirteen")
        return [[float(2 * x)] if x < 100 else "too large" for (x,) in theta]


def asked(inputs, window=0.2):
    async def all_of_them():
        batcher = Batcher(Doubling(), window)
        worker = asyncio.create_task(batcher.work())
        answers = await asyncio.gather(*(batcher.ask([x]) for x in inputs))
        worker.cancel()
        return answers, batcher.batches

    return asyncio.run(all_of_them())


def test_every_request_gets_its_own_answer_from_full_batches():
    answers, batches = asked(range(10))
    assert answers == [[2.0 * x] for x in range(10)]
    assert batches == [4, 4, 2]


def test_a_single_request_does_not_wait_for_others_for_ever():
    assert asked([5.0], window=0.001) == ([[10.0]], [1])


def test_a_failed_sample_leaves_the_others_of_its_batch_alone():
    answers, batches = asked([1.0, 100.0, 2.0])
    assert answers == [[2.0], "too large", [4.0]] and batches == [3]


def test_an_error_of_the_model_is_the_answer_and_the_worker_goes_on():
    answers, batches = asked([1.0, 13.0, 2.0, 3.0, 4.0])
    assert answers == ["ZeroDivisionError: thirteen"] * 4 + [[8.0]] and batches == [4, 1]
