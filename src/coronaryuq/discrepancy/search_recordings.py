"""Search of several recordings that one device made: each by itself, then the errors of the device by all of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.result.summary_text import write_paragraph
from coronaryuq.discrepancy.search_case import searched
from coronaryuq.discrepancy.selection.shared_device import (
    NONE,
    OTHER,
    SEPARATE,
    DeviceAnswer,
    SharedError,
    shared_device,
    shared_devices,
)
from coronaryuq.discrepancy.settings import Settings


@threadpool_limits.wrap(limits=1)
def search_recordings(
    folder: str | Path, animals: Sequence[str], out: Path, settings: Settings, seed: int,
    held_out: Sequence[str] | None = None, free_bed: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Search the recordings of several animals or patients together, and write the results.

    Parameters
    ----------
    folder, animals
        Recordings FOLDER/ANIMAL_CONDITION.csv, made by one device.
    out
        Folder for the results: of each animal as of `search_case`, with its case and a paragraph, and `device.json`.
    settings, seed
        As of `search_case`.
    held_out, free_bed
        As of `prepare_case`.

    Returns
    -------
    dict
        Content of `device.json`, and a `paragraph`.

    Raises
    ------
    InputError
        For an animal named twice, and as `prepare_case` and `search_case`.
    """
    twice = next((name for name in animals if list(animals).count(name) > 1), None)
    if twice is not None:
        raise InputError("command line", "--recordings", twice, "is named twice; name each animal once")
    cases = {animal: prepare_case(folder, animal, out / animal / "case", held_out, free_bed) for animal in animals}
    discoveries = {animal: searched(*case, settings, seed) for animal, case in cases.items()}
    devices = shared_devices({name: found.problem for name, found in discoveries.items()})
    answers = [shared_device(discoveries, quantity, places) for quantity, places in devices]
    texts = []
    for animal, discovery in discoveries.items():
        write.write(discovery, out / animal)
        texts.append(f"{animal}: " + write_paragraph(out / animal / "discrepancy.json", out / animal / "paragraph.txt"))
    described = [_described(answer) for answer in answers]
    content: dict[str, Any] = {"recordings": list(animals), "devices": described}
    write_json(out / "device.json", content)
    return content | {"paragraph": "\n".join([*map(in_words, described), *texts])}


def _described(answer: DeviceAnswer) -> dict[str, Any]:
    ranked = sorted(answer.errors, key=lambda one: -answer.probabilities[one.effect.name])
    return {
        "quantity": answer.quantity,
        "places": dict(answer.places),
        "probabilities": dict(answer.probabilities),
        "errors": [_error(one) for one in ranked],
    }


def _error(one: SharedError) -> dict[str, Any]:
    return {
        "effect": one.effect.name,
        "sizes": one.effect.with_intervals(one.mean, one.covariance),
        "each": {name: one.effect.with_intervals(own.mean, own.covariance) for name, own in one.each.items()},
        "agreement_p": one.agreement,
    }


def in_words(device: dict[str, Any]) -> str:
    """Return the answer about one device in a sentence or two."""
    names = list(device["places"])
    read = f"One device reads {device['quantity']} in {', '.join(names[:-1])} and {names[-1]}"
    name, probability = max(device["probabilities"].items(), key=lambda item: item[1])
    if name == NONE:
        return f"{read}: no delay, low-pass or resonance of its chain (probability {probability:.2f})."
    if name == OTHER:
        leading = f" Of the listed errors, {_sized(device['errors'][0])}, would suit best." if device["errors"] else ""
        return f"{read}: something else is missing in these recordings (probability {probability:.2f}).{leading}"
    if name == SEPARATE:
        return f"{read}: separate errors in each recording, not one shared error (probability {probability:.2f})."
    error = next(one for one in device["errors"] if one["effect"] == name)
    each = [f"{recording} {', '.join(map(_in_unit, own))}" for recording, own in error["each"].items()]
    return (
        f"{read}: {_sized(error)}, probability {probability:.2f}. "
        f"By each recording alone: {'; '.join(each)}; p = {error['agreement_p']:.2g} for one size."
    )


def _sized(error: dict[str, Any]) -> str:
    sizes = ", ".join(f"{one['name'].replace('_', ' ')} {_in_unit(one)}" for one in error["sizes"])
    return f"{error['effect'].replace('_', ' ')} with {sizes} (90 % intervals)"


def _in_unit(size: dict[str, Any]) -> str:
    unit = "" if size["unit"] in ("", "1") else f" {size['unit']}"
    return f"{size['value']:.3g}{unit} ({size['low']:.3g} to {size['high']:.3g})"
