"""Costs are summed by stage."""

from coronaryuq.report import costs


def test_only_the_last_attempt_of_a_job_counts(tmp_path):
    (tmp_path / "flow3d").mkdir()
    line = "flow3d_batch {}: done; cost: wall {} s, cpu {} s, memory {} MB\n"
    (tmp_path / "flow3d" / "batch_0.log").write_text(
        line.format(0, "9.00", "8.00", 100) + line.format(0, "3.00", "2.00", 90)
    )
    (tmp_path / "flow3d" / "batch_1.log").write_text(line.format(1, "5.00", "4.00", 120))
    (tmp_path / "case.log").write_text("case: started\n")
    flow3d, total = costs.costs(tmp_path)
    assert flow3d == {"name": "flow3d", "jobs": 2, "wall": "8", "cpu": "6", "memory": "120"}
    assert (total["name"], total["jobs"], total["cpu"]) == ("all", 2, "6")
