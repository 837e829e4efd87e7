"""Costs of jobs add up, rule by rule."""

from coronaryuq.core.io.atomic import write_json
from coronaryuq.report.costs import costs


def test_costs_are_summed_by_rule(tmp_path):
    jobs = [("flow3d_batch flow3d 0", 3.0, 2.0, 90), ("flow3d_batch flow3d 1", 5.0, 4.0, 120), ("case", 1.0, 1.0, 50)]
    files = [tmp_path / f"{number}.json" for number in range(len(jobs))]
    for path, (job, wall, cpu, memory) in zip(files, jobs, strict=True):
        write_json(path, {"job": job, "wall_s": wall, "cpu_s": cpu, "memory_mb": memory})
    flow3d, _, total = costs(files)
    assert flow3d == {"name": "flow3d_batch", "jobs": 2, "wall": "8", "cpu": "6", "memory": "120"}
    assert total == {"name": "all", "jobs": 3, "wall": "9", "cpu": "7", "memory": "120"}
