"""Files altered at random: every reader accepts them or reports on one line what is wrong, and nothing else."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coronaryuq import config
from coronaryuq.calibration.targets import read_targets
from coronaryuq.case.case_json import read_case
from coronaryuq.case.description.fields import read_description
from coronaryuq.case.tables.read import read_case_targets, read_outlets
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.inference.read_problem import read_series
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from coronaryuq.zerod.network.read import read_network
from support.sound_inputs import write_image

FUZZ = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def measurements(path):
    model = read_network(path.with_name("model.json"))
    file = path.with_name("conditions.yaml")
    read_series(model, path, read_conditions(file), file)


def draws(path):
    draw_samples(path, PosteriorSettings(), 1, "pilot", 2, path.with_name("drawn.csv"))


TEXTS = [
    ("campaign.yaml", config.load),
    ("case.yaml", read_description),
    ("conditions.yaml", read_conditions),
    ("model.json", read_network),
    ("case/case.json", read_case),
    ("batch_0.jsonl", records.read),
    ("outlets.csv", read_outlets),
    ("targets.csv", read_case_targets),
    ("targets.csv", read_targets),
    ("measurements.csv", measurements),
    ("pullback.csv", measurements),
    ("draws.csv", draws),
]

edits = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 6), st.binary(max_size=12)), min_size=1, max_size=4
)  # share of the file, bytes to take out there, bytes to put there
values = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(), st.text(max_size=5), st.just({}),
    st.just([]),    st.lists(st.floats(), max_size=3), st.just([{}]), st.just({"t": [0]}),
)  # fmt: skip


def read_or_one_line(read, path):
    try:
        read(path)
    except InputError as error:
        assert "\n" not in str(error) and str(path.parent) in str(error)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "read"), TEXTS, ids=[f"{n}-{r.__name__}" for n, r in TEXTS])
@FUZZ
@given(edits=edits)
def test_files_with_altered_bytes_are_read_or_reported(corrupted, name, read, edits):
    path = corrupted / name
    whole = path.read_bytes()
    altered = whole
    for share, out, put in edits:
        at = int(share * len(altered))
        altered = altered[:at] + put + altered[at + out :]
    try:
        path.write_bytes(altered)
        read_or_one_line(read, path)
    finally:
        path.write_bytes(whole)


def places(value, here=()):
    """List every place of a JSON value, as keys from its root."""
    found = [here] if here else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        found += places(inner, (*here, key))
    return found


@pytest.mark.parametrize(
    ("name", "read"), [("model.json", read_network), ("case/case.json", read_case)], ids=["network", "case"]
)
@FUZZ
@given(data=st.data())
def test_files_with_altered_values_are_read_or_reported(corrupted, name, read, data):
    path = corrupted / name
    whole = path.read_text()
    altered = json.loads(whole)
    *above, last = data.draw(st.sampled_from(places(altered)))
    at = altered
    for key in above:
        at = at[key]
    if data.draw(st.booleans()):
        at[last] = data.draw(values)
    else:
        del at[last]
    try:
        path.write_text(json.dumps(altered))
        read_or_one_line(read, path)
    finally:
        path.write_text(whole)


NATIVE = """
import random, sys
from pathlib import Path
from coronaryuq.case.perfusion.images import read_image
from coronaryuq.case.anatomy.tree import read_tree
from coronaryuq.core.errors import InputError
from coronaryuq.perfusion.territories import Ventricle

folder, seed = Path(sys.argv[1]), int(sys.argv[2])
readers = {"case/lv.vtu": lambda p: Ventricle.read(p, 1.05), "case/tree.vtp": read_tree, "plain.nii": read_image}
random.seed(seed)
for name, read in readers.items():
    whole = (folder / name).read_bytes()
    head = min(len(whole), 2000 if name != "plain.nii" else 352)
    for number in range(25):
        altered = bytearray(whole)
        for _ in range(random.randint(1, 4)):
            altered[random.randrange(head)] = random.choice(b'\\x00\\xff<>"=/0129 azAZ')
        path = folder / f"altered{Path(name).suffix}"
        path.write_bytes(altered)
        try:
            read(path)
        except InputError as error:
            assert "\\n" not in str(error)
print("through")
"""


@pytest.mark.slow
def test_meshes_and_images_with_altered_headers_are_read_or_reported(corrupted):
    """In a process of its own, because the readers are native code that could crash."""
    write_image(corrupted / "plain.nii")
    with contextlib.suppress(KeyError):
        os.environ.pop("PYTEST_CURRENT_TEST")
    done = subprocess.run([sys.executable, "-c", NATIVE, str(corrupted), "1"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip().endswith("through"), done.stderr[-2000:]


@pytest.mark.slow
def test_the_sources_never_execute_code_from_data():
    """No pickle, no unsafe load, no shell, by the syntax tree of every source file."""
    import ast

    root = Path(__file__).parents[2]
    modules = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}
    found = []
    for path in [*root.glob("src/**/*.py"), *root.glob("workflow/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(root)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import) and modules & {alias.name.split(".")[0] for alias in node.names}:
                found.append(f"{where}: imports pickle")
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in modules:
                found.append(f"{where}: imports pickle")
            if not isinstance(node, ast.Call):
                continue
            called, keys = ast.unparse(node.func), {k.arg: ast.unparse(k.value) for k in node.keywords}
            if called in ("eval", "exec", "os.system", "os.popen", "yaml.unsafe_load", "yaml.full_load"):
                found.append(f"{where}: {called}")
            if called == "yaml.load" and keys.get("Loader") not in ("_Loader", "yaml.SafeLoader"):
                found.append(f"{where}: yaml.load without a safe loader")
            if called == "torch.load" and keys.get("weights_only") != "True":
                found.append(f"{where}: torch.load without weights_only")
            if keys.get("allow_pickle", "False") != "False" or keys.get("shell", "False") != "False":
                found.append(f"{where}: {called} with pickle or a shell")
            if called.endswith(("read_pickle", "to_pickle")):
                found.append(f"{where}: {called}")
    assert not found, "\n".join(found)
    for path in root.glob("workflow/rules/*.smk"):
        for line in path.read_text().splitlines():
            assert not ("{input" in line and ":q}" not in line), f"{path.name}: unquoted file name: {line}"
