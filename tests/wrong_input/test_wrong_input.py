"""Wrong files are reported on one line that names the file, the fault and the remedy; nothing is written."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from coronaryuq import config
from coronaryuq.calibration.targets import read_targets
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.inference.read_problem import read_series
from coronaryuq.estimation.runs.gather import RunFiles
from coronaryuq.estimation.runs.gather import gather as gather_runs
from coronaryuq.flow3d.mesh.generation.folder import unpack
from coronaryuq.perfusion.stage import gather as gather_perfusion
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from coronaryuq.zerod.network.read import read_network
from support.sound_inputs import BEDS, PERFUSION

pytestmark = pytest.mark.slow


def configuration(given, out):
    config.load(given / "campaign.yaml")


def case(given, out):
    prepare_case(given / "case.yaml", CaseSettings(), out)


def image_case(given, out):
    text = (given / "case.yaml").read_text()
    text = text.replace("file: lv.vtu, array: MBF", "file: mbf.nii.gz").replace("length_unit: cm}", "length_unit: mm}")
    (given / "case.yaml").write_text(text)
    case(given, out)


def network(given, out):
    read_network(given / "model.json")


def perfusion(given, out):
    gather_perfusion(
        [given / "chunk_0.npz"], given / "case/case.json", given / "case/lv.vtu", PERFUSION, out / "targets.json"
    )


def clinical(given, out):
    read_targets(given / "targets.csv")


def measured(given, out):
    model = read_network(given / "model.json")
    conditions = read_conditions(given / "conditions.yaml")
    for table in ("measurements.csv", "pullback.csv"):
        read_series(model, given / table, conditions, given / "conditions.yaml")


def draws(given, out):
    draw_samples(given / "draws.csv", PosteriorSettings(), 1, "pilot", 4, out / "pilot.csv")


def runs(given, out):
    zerod = ([given / "pilot_0.parquet"], [given / "propagation_0.parquet"])
    limits = {"r": (0.5, 2.0), "R_cor_scaling": (0.7, 1.25)}
    tables = (given / "pilot.csv", given / "propagation.csv")
    gather_runs(RunFiles(given / "case/case.json", *tables, [given / "batch_0.jsonl"], *zerod), limits, 4, out)


def archive(given, out):
    unpack(given / "mesh-complete.zip", out)


def text(content):
    return lambda path: path.write_text(content)


def replaced(old, new, count=1):
    def corrupt(path):
        before = path.read_text()
        assert old in before
        path.write_text(before.replace(old, new, count))

    return corrupt


def cut(share):
    return lambda path: path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def flipped(path):
    """Invert bytes in the middle, as a bad disk or a broken transfer would."""
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = bytes(255 - b for b in content[middle : middle + 64])
    path.write_bytes(bytes(content))


def gone(path):
    path.unlink()


def folder(path):
    path.unlink()
    path.mkdir()


def changed(*keys, to=None, drop=False):
    """Change or delete one place of a JSON file, by its keys."""

    def corrupt(path):
        whole = json.loads(path.read_text())
        at = whole
        for key in keys[:-1]:
            at = at[key]
        if drop:
            del at[keys[-1]]
        else:
            at[keys[-1]] = to
        path.write_text(json.dumps(whole))

    return corrupt


def column(name, values=None):
    """Drop a column of a CSV or Parquet file, or change its first value."""

    def corrupt(path):
        parquet = path.suffix == ".parquet"
        frame = pd.read_parquet(path) if parquet else pd.read_csv(path)
        if values is None:
            frame = frame.drop(columns=name)
        else:
            frame[name] = [values, *frame[name].astype(object)[1:]]
        frame.to_parquet(path) if parquet else frame.to_csv(path, index=False)

    return corrupt


def arrays(**change):
    """Replace arrays of an `.npz`, or drop them (None)."""

    def corrupt(path):
        with np.load(path) as held:
            kept = {name: held[name] for name in held.files}
        np.savez(path, **{n: v for n, v in (kept | change).items() if v is not None})

    return corrupt


def mesh(change):
    def corrupt(path):
        import pyvista as pv

        data = pv.read(path)
        change(data).save(path)

    return corrupt


def without(name):
    def change(data):
        for held in (data.point_data, data.cell_data):
            if name in held:
                del held[name]
        return data

    return mesh(change)


def filled(name, value):
    def change(data):
        held = data.point_data if name in data.point_data else data.cell_data
        held[name] = np.full(len(held[name]), value)
        return data

    return mesh(change)


def pickled(path):
    np.savez(path, first=0, seed=1, flow_outlet=np.array([{"a": 1}], object))


def climbing(path):
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("../../outside.txt", "out")


VESSEL = ("vessels", 0)
WRONG = [
    (configuration, "campaign.yaml", gone, "no such file"),
    (configuration, "campaign.yaml", folder, "is a folder; name a file"),
    (configuration, "campaign.yaml", text(""), "not a configuration"),
    (configuration, "campaign.yaml", text("name: [x"), "not valid YAML"),
    (configuration, "campaign.yaml", text("name: x\nname: y\n"), "name: given twice, in lines 1 and 2"),
    (configuration, "campaign.yaml", text("a: &a [x]\nb: [*a, *a]\n"), "aliases"),
    (configuration, "campaign.yaml", text("name: !!python/object/apply:os.system [ls]\n"), "not valid YAML"),
    (configuration, "campaign.yaml", text("name: '$(touch hacked); rm -rf x'\n"), "name = '$(touch hacked)"),
    (configuration, "campaign.yaml", text("name: ../x\n"), "name = '../x'"),
    (configuration, "campaign.yaml", text("name: x\nseed: 1.5\n"), "seed = 1.5"),
    (configuration, "campaign.yaml", text("name: x\nsamples: {n_3d: -4}\n"), "samples.n_3d = -4"),
    (configuration, "campaign.yaml", text("name: x\nsamples: [3]\n"), "samples = [3]"),
    (configuration, "campaign.yaml", text("name: x\nflow3d: {step: 3}\n"), "flow3d.step = 3: unknown setting"),
    (configuration, "campaign.yaml", text("name: x\nbackend: fluent\n"), "backend = 'fluent'"),
    (configuration, "campaign.yaml", lambda p: p.write_bytes(b"name: \xff\xfe"), "not UTF-8 text"),
    (case, "case.yaml", gone, "no such file"),
    (case, "case.yaml", text("a: &a [*a]\n"), "aliases"),
    (case, "case.yaml", replaced("outlets.csv", "'; rm -rf .csv'"), "= '; rm -rf .csv': no such file"),
    (case, "case.yaml", replaced("unit: cm}", "unit: inch}"), "anatomy.unit = 'inch'"),
    (case, "case.yaml", replaced("start: 1.0", "start: 9.0"), "end must be greater than start"),
    (case, "case.yaml", replaced("vessel: lca1", "vessel: lca9"), "lca9"),
    (case, "tree.vtp", gone, "no such file"),
    (case, "tree.vtp", text(""), "empty or truncated"),
    (case, "tree.vtp", cut(0.6), "empty or truncated"),
    (case, "tree.vtp", text("<VTKFile type='PolyData'><PolyData/></VTKFile>"), "tree.vtp"),
    (case, "tree.vtp", without("Radius"), "Radius: point data missing"),
    (case, "tree.vtp", filled("Radius", -0.1), "radi"),
    (case, "tree.vtp", filled("Radius", np.nan), "radi"),
    (case, "tree.vtp", filled("VesselName", "one"), "VesselName = 'one': duplicate"),
    (case, "lv.vtu", cut(0.5), "lv.vtu"),
    (case, "lv.vtu", flipped, "lv.vtu"),
    (case, "lv.vtu", text("not a mesh"), "lv.vtu"),
    (case, "lv.vtu", without("MBF"), "no such array"),
    (case, "lv.vtu", filled("MBF", np.nan), "848 missing"),
    (case, "lv.vtu", filled("MBF", -1.0), "values: none is positive; choose another array"),
    (case, "lv.vtu", filled("MBF", 300.0), "perfusion.unit"),
    (case, "outlets.csv", column("branch"), "branch: column missing"),
    (case, "outlets.csv", column("perfuses", "lung"), "lung"),
    (case, "outlets.csv", column("vessel", "lca7"), "lca7"),
    (case, "outlets.csv", text("name,vessel,perfuses,branch\n"), "outlets.csv"),
    (case, "outlets.csv", lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff"), "outlets.csv"),
    (case, "targets.csv", text("PaoMean,Mean,ninety\n"), "ninety"),
    (case, "targets.csv", text("PaoMeen,Mean,90\n"), "PaoMeen"),
    (clinical, "targets.csv", text("PaoMean,Mean,-90\n"), "PaoMean = -90.0: implausible"),
    (clinical, "targets.csv", text("PaoMean,Mean,nan\n"), "PaoMean"),
    (image_case, "mbf.nii.gz", cut(0.5), "mbf.nii.gz"),
    (image_case, "mbf.nii.gz", text("none"), "no readable header"),
    (image_case, "mbf.nii.gz", gone, "no such file"),
    (network, "model.json", cut(0.7), "not valid JSON"),
    (network, "model.json", text("[]"), "expected a JSON object"),
    (network, "model.json", text("[" * 100000), "not valid JSON"),
    (network, "model.json", changed(*VESSEL, "zero_d_element_values", "R_poiseuille", to="high"), "R_poiseuille"),
    (network, "model.json", changed(*VESSEL, "zero_d_element_values", "R_poiseuille", to=float("nan")), "R_poiseuille"),
    (network, "model.json", changed(*VESSEL, "zero_d_element_type", to="Pipe"), "Pipe"),
    (network, "model.json", changed(*VESSEL, "boundary_conditions", "outlet", to="NONE"), "NONE"),
    (network, "model.json", changed(*VESSEL, "vessel_id", to="0"), "vessel_id = '0'"),
    (network, "model.json", changed("boundary_conditions", drop=True), "boundary_conditions: missing"),
    (network, "model.json", changed("boundary_conditions", 0, "bc_values", "t", to=[0, 0.5, 0.2]), "INFLOW"),
    (network, "model.json", changed("simulation_parameters", to=3), "simulation_parameters"),
    (network, "model.json", changed("junctions", to=[{"junction_name": "J0"}]), "J0"),
    (network, "model.json", changed("vesels", to=[]), "vesels"),
    (measured, "measurements.csv", column("sd"), "sd: column missing"),
    (measured, "measurements.csv", column("sd", -0.1), "sd"),
    (measured, "measurements.csv", column("value", "high"), "value"),
    (measured, "measurements.csv", column("unit", "L"), "unit"),
    (measured, "measurements.csv", column("condition", "exercise"), "exercise"),
    (measured, "measurements.csv", column("location", "lda:OUT"), "lda:OUT"),
    (measured, "measurements.csv", text("condition,quantity\n"), "column missing"),
    (measured, "pullback.csv", column("distance", 12.0), "expected 0 to 10 mm"),
    (measured, "pullback.csv", column("distance_unit", "inch"), "mm or cm"),
    (measured, "pullback.csv", column("location", "lda"), "no such vessel"),
    (measured, "conditions.yaml", text("rest: {resistance: 2}\n"), "rest.resistance: unknown key"),
    (measured, "conditions.yaml", text("rest: {period_scale: .nan}\n"), "period_scale"),
    (measured, "conditions.yaml", text("- rest\n"), "expected a mapping"),
    (measured, "conditions.yaml", text("rest: !!python/name:os.system\n"), "not valid YAML"),
    (draws, "draws.csv", text(""), "draws.csv"),
    (draws, "draws.csv", column("log_density"), "log_density: column missing"),
    (draws, "draws.csv", column(BEDS[0], "x"), BEDS[0]),
    (draws, "draws.csv", column(BEDS[0], np.inf), BEDS[0]),
    (perfusion, "chunk_0.npz", cut(0.8), "chunk_0.npz"),
    (perfusion, "chunk_0.npz", text(""), "chunk_0.npz"),
    (perfusion, "chunk_0.npz", flipped, "chunk_0.npz"),
    (perfusion, "chunk_0.npz", pickled, "chunk_0.npz: not readable arrays"),
    (perfusion, "chunk_0.npz", arrays(seed=None), "seed: array missing"),
    (perfusion, "chunk_0.npz", arrays(first=np.int64(20)), "first = 20"),
    (perfusion, "case/case.json", cut(0.9), "not valid JSON"),
    (perfusion, "case/case.json", changed("outlets", 0, "perfuses", to="all"), "outlets.0.perfuses = 'all'"),
    (perfusion, "case/case.json", changed("outlets", 1, "bc", drop=True), "outlets.1.bc: missing"),
    (perfusion, "case/case.json", changed("tissue_density", to=0), "tissue_density = 0"),
    (perfusion, "case/lv.vtu", cut(0.5), "lv.vtu: empty or truncated"),
    (perfusion, "case/lv.vtu", without("Volume"), "Volume: cell data missing"),
    (runs, "batch_0.jsonl", cut(0.7), "truncated records"),
    (runs, "batch_0.jsonl", text(""), "truncated records"),
    (runs, "batch_0.jsonl", text("{}\n"), "line 1"),
    (runs, "batch_0.jsonl", text('{"sample": "pilot_00000", "inputs": 3}\n'), "line 1"),
    (runs, "batch_0.jsonl", text('{"sample": "pilot_00000", "inputs": {}, "outputs": {"ffr_lad": "x"}}\n'), "line 1"),
    (runs, "batch_0.jsonl", text('{"sample": "p", "inputs": {}, "status": "fine"}\n'), "line 1"),
    (runs, "pilot_0.parquet", cut(0.5), "pilot_0.parquet"),
    (runs, "pilot_0.parquet", column("status"), "status: column missing"),
    (runs, "pilot.csv", column("sample", "pilot_00099"), "pilot_00099"),
    (archive, "mesh-complete.zip", cut(0.5), "not a zip archive"),
    (archive, "mesh-complete.zip", climbing, "outside"),
]


def name_of(entry):
    read, file, _, said = entry
    return f"{read.__name__}-{file}-{said[:30]}"


@pytest.mark.parametrize(("read", "file", "corrupt", "said"), WRONG, ids=map(name_of, WRONG))
def test_a_wrong_file_is_reported_on_one_line_and_nothing_is_written(corrupted, tmp_path, read, file, corrupt, said):
    corrupt(corrupted / file)
    with pytest.raises(InputError) as caught:
        read(corrupted, tmp_path / "out")
    line = str(caught.value)
    assert "\n" not in line and line.startswith(str(corrupted))
    assert Path(file).name in line or read in (case, image_case, runs), (
        "a fault of a case may be reported for its description"
    )
    assert said in line
    assert len(line.partition(": ")[2]) > 10, "names a remedy"
    assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert not (tmp_path / "outside.txt").exists() and not (tmp_path.parent / "outside.txt").exists()


def test_at_least_sixty_faults_are_tried():
    assert len(WRONG) >= 60


READERS = sorted({entry[0] for entry in WRONG}, key=lambda read: read.__name__)


@pytest.mark.parametrize("read", READERS, ids=[read.__name__ for read in READERS])
def test_the_example_is_valid_before_it_is_corrupted(corrupted, tmp_path, read):
    read(corrupted, tmp_path / "out")
