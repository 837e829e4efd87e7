"""Runs of the perfusion stage on a small left ventricle."""

from coronaryuq.perfusion import stage


def gathered(ventricle, folder, settings, seed=5, chunks=((0, None),)):
    """Run chunks (first, number) and gather them in reverse order; return the path of `targets.json`."""
    case, lv = ventricle
    paths = []
    for first, count in chunks:
        count = settings.realisations - first if count is None else count
        paths.append(folder / f"chunk_{first}.npz")
        stage.run_chunk(case, lv, settings, seed, first, count, paths[-1])
    out = folder / "targets.json"
    stage.gather(paths[::-1], case, lv, settings, out)
    return out
