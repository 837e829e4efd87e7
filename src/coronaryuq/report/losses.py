"""Pressure losses that 3D runs taught the 0D model, in words and as a table for the report."""

from collections.abc import Mapping

from coronaryuq.case.network.network_names import InWords
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv


def learnt(files: Mapping[str, str], stenoses: list[str], in_words: InWords) -> dict:
    """Return a sentence and the rows of the losses that are certain; an empty sentence if nothing was learnt.

    Parameters
    ----------
    files
        Paths of the report's inputs; `losses_fit` and `losses` if 3D runs taught the 0D model.
    stenoses
        Names of the stenoses, in whose places pressure over aortic pressure is FFR.
    in_words
        What a reader calls the 0D vessels.
    """
    if "losses_fit" not in files:
        return {"sentence": "", "rows": []}
    fit, table = read_json(files["losses_fit"], ("runs", "rms")), read_csv(files["losses"])
    errors = [fit["rms"][name] for name in stenoses]
    before, after = (", ".join(f"{error[name]:.4f}" for error in errors) for name in ("before", "left_out"))
    sentence = (
        f"The 0D vessels inside the 3D domain learnt their pressure losses from {fit['runs']} 3D runs made before the "
        f"posterior. FFR by 0D differed from FFR by 3D by {before} ({', '.join(stenoses)}; root mean square) with "
        f"their own losses, and by {after} with those learnt, in runs left out."
    )
    certain = table[table["meaning"].notna() & (table["meaning"] != "")]
    rows = [
        {
            "where": _where(str(row.vessels).split(), in_words),
            "loss": row.loss,
            "own": f"{row.own_mmhg:.2f}",
            "added": f"{row.added_mmhg:+.2f} ± {row.added_sd_mmhg:.2f}",
            "meaning": row.meaning,
        }
        for row in certain.itertuples()
    ]
    return {"sentence": sentence, "rows": rows}


def _where(parts: list[str], in_words: InWords) -> str:
    """Return the vessels of which some 0D vessels are parts, with the parts' numbers."""
    numbers: dict[str, list[int]] = {}
    for part in parts:
        vessel, number = in_words.part_of(part) or (in_words(part), 0)
        numbers.setdefault(vessel, []).append(number)
    words = {vessel: ", ".join(map(str, filter(None, of))) for vessel, of in numbers.items()}
    return ", ".join(f"{vessel} (part {of})" if of else vessel for vessel, of in words.items())
