"""Costs of the jobs of a campaign by stage, from the last line of each log."""

import re
from collections import defaultdict
from pathlib import Path

COST = re.compile(r"cost: wall ([\d.]+) s, cpu ([\d.]+) s, memory (\d+) MB")


def costs(logs: Path) -> list[dict]:
    """Return the costs of each stage and their sum, from a folder of job logs."""
    stages: dict[str, dict] = defaultdict(lambda: {"jobs": 0, "wall": 0.0, "cpu": 0.0, "memory": 0.0})
    for path in sorted(logs.rglob("*.log")):
        matches = COST.findall(path.read_text(encoding="utf-8", errors="replace"))
        if not matches:
            continue
        name = path.relative_to(logs).parts[0].removesuffix(".log")
        wall, cpu, memory = map(float, matches[-1])
        line = stages[name]
        line["jobs"] += 1
        line["wall"] += wall
        line["cpu"] += cpu
        line["memory"] = max(line["memory"], memory)
    total = {"name": "all", "jobs": sum(v["jobs"] for v in stages.values())}
    total |= {"wall": sum(v["wall"] for v in stages.values()), "cpu": sum(v["cpu"] for v in stages.values())}
    total["memory"] = max((v["memory"] for v in stages.values()), default=0.0)
    lines = [{"name": name, **value} for name, value in stages.items()] + [total]
    return [
        line | {"wall": f"{line['wall']:.0f}", "cpu": f"{line['cpu']:.0f}", "memory": f"{line['memory']:.0f}"}
        for line in lines
    ]
