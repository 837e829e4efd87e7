"""What a campaign adopted from a search, and its prediction before and after, for the report."""

from collections.abc import Mapping
from typing import Any

from coronaryuq.core.io.atomic import read_json

BY_3D = (
    "The estimates at the top of this page are made with the adopted network, by 3D and 0D runs together; this table "
    "is by 0D alone, before and after alike."
)

CORRECTED = (
    "The target flows are those of the perfusion map without its error below; the loop was tuned, and the posterior "
    "sampled, with these."
)


def adopted(files: Mapping[str, str], *, invented: bool) -> dict[str, Any]:
    """Return the section on adoption: sentences, lines of provenance, and rows of tables; empty without adoption.

    Parameters
    ----------
    files
        Paths of the report's inputs; `adoption` if the campaign adopts.
    invented
        Whether the search's measurements are invented, to test it.
    """
    if "adoption" not in files:
        return {"text": ""}
    found = read_json(files["adoption"], ("adopted", "targets_corrected", "reason", "classes", "ffr", "zones"))
    told = _text(found)
    if invented:
        told = f"This tests the loop on invented data and says nothing about the patient. {told}"
    return {
        "text": told,
        "classes": [_class(entry, found["in_lumen"], found["not_in_3d"]) for entry in found["classes"]],
        "gap": _gap(found),
        "zones": _zones(found["zones"]),
        "rows": [_row(row) for row in found["ffr"]],
        "in_lumen": _in_lumen(found["in_lumen"]),
        "not_in_3d": _not_in_3d(found["not_in_3d"]),
        "note": f"{found['samples']['after']} samples each. {BY_3D}" if _changes(found) else "",
    }


def labels(files: Mapping[str, str]) -> dict[str, str]:
    """Return the label of each column of θ that adoption added."""
    if "adoption" not in files:
        return {}
    found = {}
    for number, entry in enumerate(read_json(files["adoption"], ("classes",))["classes"], start=1):
        name = entry["members"][0]["effect"].replace("_", " ")
        for j in range(max(len(one["sizes"]) for one in entry["members"])):
            found[f"missing_{number}_size" + (f"_{j + 1}" if j else "")] = f"size of the {name}"
        found[f"missing_{number}_member"] = f"whether it is the {name}"
    return found


def _changes(found: Mapping[str, Any]) -> bool:
    """Return whether the prediction is made with another network, or from other target flows."""
    return found["adopted"] or found["targets_corrected"]


def _text(found: Mapping[str, Any]) -> str:
    if found["adopted"]:
        return (
            "The effects below became part of the campaign's network: the loop was tuned again with them, and their "
            "sizes are further uncertain parameters, with the posterior that the search found. Where data cannot tell "
            "several effects apart, each sample has one of them, by their probabilities."
        ) + (f" {CORRECTED}" if found["targets_corrected"] else "")
    if found["reason"]:
        return f"Nothing was adopted: {found['reason']}. The campaign's network is its own."
    if found["targets_corrected"]:
        return f"No effect became part of the campaign's network. {CORRECTED}"
    return "Nothing was adopted into the network, for the reasons below. The campaign's network is its own."


def _class(entry: Mapping[str, Any], in_lumen: Mapping[str, str], not_in_3d: Mapping[str, str]) -> list[dict[str, str]]:
    """Return a row per member: what, where, probability, size with interval, what became of it, and its source."""
    rows = []
    for one in entry["members"]:
        name = one["effect"].replace("_", " ")
        label = f"{name} at {one['place']}"
        beside = "0D alone" if label in not_in_3d else "0D and the 0D side of 3D"
        in_3d = "0D and the lumen of 3D" if label in in_lumen else beside
        sizes = (f"{s['name']} {s['value']:.3g} ({s['low']:.3g} to {s['high']:.3g})" for s in one["sizes"])
        rows.append(
            {
                "effect": name, "place": one["place"], "probability": f"{one['probability']:.2f}",
                "sizes": ", ".join(sizes), "became": one["refused"] or f"adopted in {in_3d}", "source": entry["source"],
            }
        )  # fmt: skip
    return rows


def _gap(found: Mapping[str, Any]) -> str:
    before, after = (
        "{:.2f} ({:.2f} to {:.2f})".format(found["gap"][when]["misfit"], *found["gap"][when]["interval_90"])
        for when in ("before", "after")
    )
    kept = ", ".join(found["held_out"])
    return f"Misfit on data held out ({kept}; 1 is expected from noise): {before} before, {after} with the effects."


def _zones(limits: list[float]) -> list[str]:
    first, last = f"FFR ≤ {limits[0]:.2f}", f"FFR > {limits[-1]:.2f}"
    return [first, *(f"{a:.2f} < FFR ≤ {b:.2f}" for a, b in zip(limits, limits[1:], strict=False)), last]


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    return {"branch": row["branch"], **{when: _predicted(row[when]) for when in ("before", "after")}}


def _predicted(one: Mapping[str, Any]) -> dict[str, Any]:
    zones = [f"{100 * share:.0f} %" for share in one["zones"]]
    failed = f"; {one['failed']} runs failed" if one["failed"] else ""
    return {"ffr": f"{one['median']:.3f} ({one['low']:.3f} to {one['high']:.3f}){failed}", "zones": zones}


def _in_lumen(places: Mapping[str, str]) -> str:
    if not places:
        return ""
    listed = "; ".join(f"{name}, {place}" for name, place in places.items())
    return (
        f"The lumen of every 3D run is narrowed by the effect that its sample has: {listed}. The throat of a stenosis "
        "is the one that has, by the published rule, the loss of its vessel and the adopted one together."
    )


def _not_in_3d(refused: Mapping[str, str]) -> str:
    if not refused:
        return ""
    listed = "; ".join(f"{name}: {reason}" for name, reason in refused.items())
    return (
        f"{listed}. Estimates by 3D do not contain these effects: where they matter, read the prediction by 0D below."
    )
