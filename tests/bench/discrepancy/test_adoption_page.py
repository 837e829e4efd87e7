"""Cases of `bench discrepancy --loop` and their table in the documents are one."""

import pytest

from support.benchmark_scripts import benchmark_script


@pytest.fixture(scope="module")
def script():
    return benchmark_script("adoption_loop")


def test_the_page_contains_the_table_of_the_cases(script):
    page = script.PAGE.read_text(encoding="utf-8")
    inside = page.split(script.START)[1].split(script.END)[0]
    assert inside.strip().splitlines() == script.table(script.joined([]))


def test_a_case_that_ran_again_is_counted_once_and_one_that_adopts_nothing_is_told(script):
    cases = script.joined([])
    again = cases[0] | {"named_right": not cases[0]["named_right"]}
    assert len(script.joined([again])) == len(cases)
    named = [case for case in cases if case["named_right"]]
    assert not any(script.same_as_before(case) for case in named)
    nothing = named[0] | {"named_right": False, "after": named[0]["before"]}
    column = script.column([nothing, named[1]])
    assert column["effect named right; nothing adopted; another effect adopted"] == "1; 1; 0"
