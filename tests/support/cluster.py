"""A real SLURM on this machine for the tests: one controller, two nodes on loopback with declared cores.

Needs Debian's `slurm-wlm` and `munge`, and root, because job steps read /etc/slurm/slurm.conf only.
"""

import fcntl
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOBase
from pathlib import Path

CONFIGURATION = Path("/etc/slurm/slurm.conf")
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol")
NODES = ("n1", "n2")


def why_not() -> str | None:
    """Why a cluster cannot be started here, or None."""
    missing = [program for program in PROGRAMS if shutil.which(program, path=_path()) is None]
    if missing:
        return f"needs Debian's slurm-wlm and munge: {', '.join(missing)} not found"
    if os.geteuid() != 0:
        return "needs root to write /etc/slurm/slurm.conf"
    if CONFIGURATION.exists() and "coronaryuq-test" not in CONFIGURATION.read_text():
        return f"{CONFIGURATION} belongs to a cluster of this machine"
    return None


@contextmanager
def cluster(folder: Path, cpus: int = 4, memory_mb: int = 64000) -> Iterator["Cluster"]:
    """Start controller and nodes with `cpus` cores and memory each, declared and not real; stop them at the end."""
    here = Cluster(folder, cpus, memory_mb)
    try:
        here.start()
        yield here
    finally:
        here.stop()


class Cluster:
    def __init__(self, folder: Path, cpus: int, memory_mb: int):
        self.folder, self.cpus, self.memory_mb = folder, cpus, memory_mb
        self.processes: dict[str, subprocess.Popen] = {}
        self.turn: TextIOBase | None = None

    def start(self) -> None:
        for part in ("state", *NODES):
            (self.folder / part).mkdir(parents=True, exist_ok=True)
        CONFIGURATION.parent.mkdir(exist_ok=True)
        # The configuration has one place only: another run of the tests waits for its turn.
        self.turn = open(CONFIGURATION.with_name("coronaryuq-test.lock"), "w")  # noqa: SIM115
        fcntl.flock(self.turn, fcntl.LOCK_EX)
        CONFIGURATION.write_text(self._configuration())
        self._start_munge()
        self._spawn("slurmctld", "slurmctld", "-D", "-c")
        for node in NODES:
            self.start_node(node)
        self._wait_for_nodes()

    def start_node(self, node: str) -> None:
        self._spawn(node, "slurmd", "-D", "-N", node)

    def kill_node(self, node: str) -> None:
        """Kill a node's daemon and what it runs, as a crash would."""
        self.processes.pop(node).kill()
        subprocess.run(["scontrol", "update", f"nodename={node}", "state=down", "reason=killed"], env=_environment())

    def node_at_work(self, seconds: float) -> str:
        """The first node on which a job runs."""
        found: list[str] = []

        def busy() -> bool:
            found[:] = subprocess.run(
                ["squeue", "-h", "-t", "RUNNING", "-o", "%N"], env=_environment(), capture_output=True, text=True
            ).stdout.split()
            return bool(found)

        _wait(busy, "a job to run", seconds)
        return found[0]

    def revive_node(self, node: str) -> None:
        self.start_node(node)
        _wait(lambda: self._resumed(node), f"{node} to come back", 60)

    def _resumed(self, node: str) -> bool:
        subprocess.run(["scontrol", "update", f"nodename={node}", "state=resume"], env=_environment())
        said = subprocess.run(
            ["sinfo", "-h", "-n", node, "-o", "%T"], env=_environment(), capture_output=True, text=True
        )
        return said.stdout.strip() == "idle"

    def stop(self) -> None:
        if "slurmctld" in self.processes:
            subprocess.run(["scancel", "--user", "root"], env=_environment(), timeout=30)
        for process in self.processes.values():
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
        if self.turn:
            CONFIGURATION.unlink(missing_ok=True)
            self.turn.close()

    def _configuration(self) -> str:
        ports = _free_ports(2 + len(NODES))
        host = socket.gethostname()
        nodes = "\n".join(
            f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={self.cpus} "
            f"RealMemory={self.memory_mb} State=UNKNOWN"
            for node, port in zip(NODES, ports[2:], strict=True)
        )
        return f"""# coronaryuq-test
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser=root
AuthType=auth/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
MpiDefault=pmi2
ReturnToService=2
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/%n
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/%n/slurmd.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/%n/slurmd.log
SchedulerParameters=sched_interval=1,bf_interval=2
SlurmdTimeout=30
KillWait=5
MinJobAge=86400
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""

    def _start_munge(self) -> None:
        if subprocess.run(["munge", "-n"], capture_output=True).returncode == 0:
            return
        Path("/run/munge").mkdir(exist_ok=True)
        shutil.chown("/run/munge", "munge", "munge")
        self.processes["munged"] = subprocess.Popen(
            ["setpriv", "--reuid=munge", "--regid=munge", "--clear-groups", "munged", "--foreground"],
            env=_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        _wait(lambda: subprocess.run(["munge", "-n"], capture_output=True).returncode == 0, "munged", 20)

    def _spawn(self, name: str, *command: str) -> None:
        with open(self.folder / f"{name}.out", "w") as out:
            self.processes[name] = subprocess.Popen(command, env=_environment(), stdout=out, stderr=out)

    def _wait_for_nodes(self) -> None:
        def idle() -> bool:
            seen = subprocess.run(
                ["sinfo", "-h", "-N", "-o", "%T"], env=_environment(), capture_output=True, text=True
            ).stdout.split()
            return seen == ["idle"] * len(NODES)

        _wait(idle, f"nodes to be idle; see {self.folder}", 60)


def _path() -> str:
    return os.environ.get("PATH", "") + os.pathsep + "/usr/sbin:/sbin"


def _environment() -> dict[str, str]:
    return os.environ | {"PATH": _path()}


def _wait(true, what: str, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        if time.monotonic() > deadline:
            raise TimeoutError(f"waited {seconds:.0f} s for {what}")
        time.sleep(0.3)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()
