"""Cases of the discrepancy benchmark and their tables in the documents are one."""

import pytest

from support.benchmark_scripts import benchmark_script

LEAK = {"effect": "side_branch_leak", "strength": "medium", "noise": "nominal", "seed": 1, "first": "side_branch_leak"}
LEAK |= {"named": True, "placed": False, "alarmed": True, "abstained": False, "covered": None, "worse": False}
LEAK |= {"before": 1.5, "after": 1.0, "oracle": 1.0, "cpu_s": 3.14159, "found": []}


@pytest.fixture(scope="module")
def script():
    return benchmark_script("discrepancy")


def test_the_pages_contain_the_tables_of_the_cases(script):
    for path, name, lines in script.tables(script.read(script.CASES)):
        page = path.read_text(encoding="utf-8")
        assert script.put(page, name, lines) == page, name


def test_a_case_that_ran_again_is_counted_once(script):
    one = script.kept(LEAK, "open loop")
    assert one["cpu_s"] == 3.14 and "covered" not in one and "found" not in one
    again = script.kept(LEAK | {"placed": True}, "open loop")
    assert script.merged([one], [again]) == [again]
    others = [script.kept(LEAK, "bundled patient"), script.kept(LEAK | {"seed": 2}, "open loop")]
    assert len(script.merged([one], others)) == 3
