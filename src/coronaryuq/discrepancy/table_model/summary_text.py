"""Summary of the search of one branch in plain English."""

from coronaryuq.core.units import percent
from coronaryuq.discrepancy.table_model.branch_search import LEFT_FLOORS
from coronaryuq.discrepancy.table_model.laws import FLOOR_FFR
from coronaryuq.discrepancy.table_model.tables import artery

STRETCHED = 2.0
"""Prior standard deviations by which recalibration may scale the model's own loss before the summary states it."""
AS_WELL = 0.95
"""Fraction of recalibration's held-out error of FFR above which a law does not predict better."""
TOGETHER = 0.3
"""Rank correlation of the tables, the largest of common quantities, below which rows may not be the same samples."""


def branch_text(answer: dict) -> str:
    """Summarise one branch. answer: its entry in `discrepancy.json`."""
    rmse, own_loss = answer["ffr_rmse"], f"multiplies the model's own loss by {answer['recalibration']['own']:.2g}"
    drops = (
        f"{artery(answer['branch'])}: the pressure drop to {answer['place']} is {answer['drop']['measured']:.1f} "
        f"measured and {answer['drop']['simulated']:.1f} simulated"
    )
    error = _error_text(rmse)
    possible = _listed(answer["possibly_also"], " or ")
    if answer["overstated"]:
        return (
            f"{drops}, and recalibration {own_loss}, {answer['own_loss_shift']:+.1f} standard deviations of its prior. "
            "The model appears to have a loss that is absent in reality, or too large a loss, or the two tables are "
            f"exchanged; no effect is named. After recalibration, o{error}"
        )
    if answer["outside_library"]:
        best = _listed(list(answer["classes"]) or ["recalibration"], " and ")
        worse = rmse["after"] > rmse["recalibration_alone"]
        failure = "predicts held-out samples worse than recalibration alone" if worse else "leaves too large an error"
        return (
            f"{drops}, and no pressure-loss law explains it: the best candidate, {best}, {failure}, and no "
            f"effect is named. With it, o{error}{_mismatch(answer)}"
        )
    if answer["alarm"] and not answer["effects"]:
        rivals = f": {possible}" if possible else ""
        return f"{drops}; the samples do not determine what is missing{rivals}. Recalibration {own_loss}. O{error}"
    if not answer["effects"] and rmse["before"] > LEFT_FLOORS * FLOOR_FFR:
        room = f" {possible[0].upper()}{possible[1:]} may also be present." if possible else ""
        return f"{drops}, which recalibration explains: it {own_loss}. No effect is needed.{room} O{error}"
    if not answer["effects"]:
        return f"{artery(answer['branch'])}: simulated and measured pressure drops agree; nothing to explain."
    return f"{drops}; the best explanation is {_named_text(answer)}O{error}{_doubts(answer, own_loss)}"


def _error_text(rmse: dict[str, float]) -> str:
    """Describe the change of the held-out error, without the first letter."""
    old, new = (f"{rmse[key]:.4f}" for key in ("before", "after"))
    change = f"stays at {new}" if old == new else f"{'falls' if new < old else 'rises'} from {old} to {new}"
    others = f"recalibration alone {rmse['recalibration_alone']:.4f}, Gaussian process {rmse['flexible']:.4f}"
    return f"n held-out samples the error of FFR {change} ({others})."


def _named_text(answer: dict) -> str:
    names = []
    for name, members in answer["classes"].items():
        rivals = _listed([m for m in members if m != name], ", ")
        names.append(
            name.replace("_", " ") + (f" (indistinguishable from it with these samples: {rivals})" if rivals else "")
        )
    sizes = ", ".join(
        f"{name.replace('_', ' ')} {s['size']:.3f} ({s['size_low']:.3f} to {s['size_high']:.3f}) of {s['of']}"
        for name, s in answer["sizes"].items()
    )
    terms = ", ".join(
        f"{t['term']} {t['size']:.4g} ({t['size_low']:.4g} to {t['size_high']:.4g}) {t['unit']}".rstrip()
        for t in answer["terms"]
    )
    return (
        f"{' and '.join(names)} (probability {answer['probability']:.2f}, selected in "
        f"{percent(answer['share_of_folds_with_this_name'])} of the folds). "
        f"Sizes with 90 % intervals: {sizes}; {terms}. "
    )


def _doubts(answer: dict, own_loss: str) -> str:
    rmse, text = answer["ffr_rmse"], ""
    if answer["doubt"]:
        text += (
            " In doubt: what the law leaves is clearly more than noise, so the missing loss has a different functional "
            "form; the sizes are those of the best law of this form."
        )
    if rmse["after"] > AS_WELL * rmse["recalibration_alone"]:
        text += (
            " In doubt: recalibration alone, which scales the model's own linear loss, predicts held-out samples "
            "equally well."
        )
    text += _mismatch(answer)
    if abs(answer["own_loss_shift"]) > STRETCHED:
        text += (
            f" With it, recalibration {own_loss} ({answer['own_loss_shift']:+.1f} standard deviations of its prior)."
        )
    if answer["possibly_also"]:
        names = [f"{name} (probability {answer['inclusion'][name]:.2f})" for name in answer["possibly_also"]]
        also = _listed(names, " or ")
        text += f" {also[0].upper()}{also[1:]} may also be present."
    return text


def _mismatch(answer: dict) -> str:
    """Warn of tables whose rows may not be the same samples."""
    if answer["rank_correlation"] >= TOGETHER:
        return ""
    return (
        " In doubt: simulated and measured values are hardly correlated (rank correlation at most "
        f"{max(answer['rank_correlation'], 0.0):.2f}); check that a row of both tables is the same sample."
    )


def _listed(names: list[str], separator: str) -> str:
    return separator.join(names).replace("_", " ")
