"""One paragraph in plain words about what was found, for the report."""

from coronaryuq.discrepancy.search import CENTRAL_99, Discovery


def paragraph(found: Discovery, held_out: list[str]) -> str:
    """What disagrees, what is missing, how sure, how far the gap shrinks; or that there is nothing to explain."""
    count = len(found.base.residual)
    if not found.alarm:
        return (
            f"The model, recalibrated within its priors, agrees with the {count} fitted measurements "
            f"(global test {chance(found.located.p)}): there is nothing to explain. "
            f"On {_kept(held_out)} its misfit is {found.before.misfit:.2f} standard deviations of the noise."
        )
    worst = found.located.groups[0]
    text = (
        f"The model disagrees with the {count} fitted measurements beyond what recalibration can mend "
        f"(global test {chance(found.located.p)}), most in the {worst.quantity} at {worst.location} "
        f"under {worst.condition}. "
    )
    if found.redistributed:
        places = " and ".join(entry.accepted.place for entry in found.rounds if entry.accepted is not None)
        text += (
            f"Flow probes off at {places} would explain it, but what one reads too much the other reads too little: "
            "blood that goes elsewhere than the network says, as through swapped or wrongly wired outlets, explains "
            "the same with one cause, which the library does not have. It is not named."
        )
        return text
    if found.outside_library:
        text += (
            "No effect of the library explains it: a flexible discrepancy predicts measurements that no fit had seen "
            f"clearly better than every named candidate (misfit {found.flexible.misfit:.2f} against "
            f"{found.after.misfit:.2f}). "
            "The residual waveforms show where it acts and its shape; it is not named."
        )
        return text
    if not found.named:
        text += "No effect of the library explains it well enough to be named. "
    for number, entry in enumerate(found.named):
        one = entry.accepted
        text += f"{'Missing' if number == 0 else 'Also missing'} is {one.effect.name.replace('_', ' ')} at {one.place}"
        share = sum(member.probability for member in entry.members)
        text += f" (probability {share:.2f}"
        if len(entry.members) > 1:
            others = ", ".join(f"{m.effect.name.replace('_', ' ')} at {m.place}" for m in entry.members[1:])
            text += f", together with what these data cannot tell from it: {others}"
        text += "). "
        for parameter in found.beyond_prior(one.acting):
            low, high = (float(parameter.from_standard(k * CENTRAL_99)) for k in (-1, 1))
            size = parameter.name.replace("_", " ")
            text += (
                f"Its {size} lies beyond the central 99 % of what is thought possible ({low:.3g} to {high:.3g}): "
                "it may stand for something that the library does not have. "
            )
    text += (
        f"On {_kept(held_out)} the misfit falls from {found.before.misfit:.2f} to {found.after.misfit:.2f} "
        "standard deviations of the noise, whose floor is 1. "
    )
    if found.remaining.alarm(found.problem.settings.alarm_level):
        text += f"Something remains unexplained ({chance(found.remaining.p)})"
        if found.flexible.total_lpd > found.after.total_lpd:
            text += (
                ": a flexible discrepancy predicts those measurements better than the named effects alone, and better "
                f"still together with them (log predictive density per row {found.after.lpd:.2f}, "
                f"{found.flexible.lpd:.2f}, {found.both.lpd:.2f})"
            )
        text += "."
    else:
        text += f"What remains is within the noise ({chance(found.remaining.p)})."
    return text


def chance(p: float) -> str:
    """A p-value in words, where it is too small for a number too."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"


def _kept(held_out: list[str]) -> str:
    if held_out:
        return f"the conditions kept out of every fit ({', '.join(held_out)})"
    return "each condition in turn, left out of the fit"
