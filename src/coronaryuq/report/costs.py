"""What the jobs of a campaign cost, stage by stage, from the last line of each log."""

import re
from collections import defaultdict
from pathlib import Path

COST = re.compile(r"cost: wall ([\d.]+) s, cpu ([\d.]+) s, memory (\d+) MB")


def costs(logs: Path) -> list[dict]:
    """Costs by rule, from the last line of every job's log."""
    found = defaultdict(lambda: {"jobs": 0, "wall": 0.0, "cpu": 0.0, "memory": 0.0})
    for path in sorted(logs.rglob("*.log")):
        said = COST.findall(path.read_text(encoding="utf-8", errors="replace"))
        if not said:
            continue
        name = path.relative_to(logs).parts[0].removesuffix(".log")
        wall, cpu, memory = map(float, said[-1])
        line = found[name]
        line["jobs"] += 1
        line["wall"] += wall
        line["cpu"] += cpu
        line["memory"] = max(line["memory"], memory)
    total = {"name": "all", "jobs": sum(v["jobs"] for v in found.values())}
    total |= {"wall": sum(v["wall"] for v in found.values()), "cpu": sum(v["cpu"] for v in found.values())}
    total["memory"] = max((v["memory"] for v in found.values()), default=0.0)
    lines = [{"name": name, **value} for name, value in found.items()] + [total]
    return [
        line | {"wall": f"{line['wall']:.0f}", "cpu": f"{line['cpu']:.0f}", "memory": f"{line['memory']:.0f}"}
        for line in lines
    ]
