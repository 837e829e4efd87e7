"""Samples that march together, and the lane that each has in the groups that the kernels work on."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.zerod.solver.kernel_tables import Record
from coronaryuq.zerod.solver.lane_tables import Group, gather_lanes
from coronaryuq.zerod.solver.lanes import LANES, table


@dataclass
class Batch:
    """Samples that march together: their state y, ẏ (n, 2 unknowns), tables of their groups, and their last cycle.

    seats: the sample in each lane of each group, fewer than `LANES` in the last. failed_at: (n,) step at which a sample
    failed in its last cycle, or 0. statistics: mean, minimum and maximum of the recorded unknowns, (n, ·) each. floor,
    ceiling: range of every y. waves: (·, n, steps + 1) or empty, of samples whose waves were kept. records: of each
    group's last cycle.
    """

    parameters: dict[str, np.ndarray]
    offsets: np.ndarray
    state: np.ndarray
    failed_at: np.ndarray
    groups: list[Group] = field(default_factory=list)
    seats: list[np.ndarray] = field(default_factory=list)
    statistics: tuple[np.ndarray, ...] = ()
    floor: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    ceiling: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    waves: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0)))
    records: list[Record] = field(default_factory=list)

    def allocate_records(self, recorded: np.ndarray, steps: int, waves: bool) -> None:
        """Allocate statistics, and waves if wanted, of the stacked unknowns `recorded` for cycles of `steps` steps."""
        samples, size = len(self.state), self.state.shape[1] // 2
        self.statistics = tuple(np.full((samples, len(recorded)), np.nan) for _ in range(3))
        self.floor, self.ceiling = np.zeros((samples, size)), np.zeros((samples, size))
        self.waves = np.empty((len(recorded) if waves else 0, samples, steps + 1))
        self.records = [
            Record(
                recorded.astype(np.uint32),
                table(len(recorded)),
                table(len(recorded)),
                table(len(recorded)),
                np.empty((steps + 1 if waves else 0, len(recorded), LANES)),
                table(size),
                table(size),
            )
            for _ in range(-(-samples // LANES))
        ]

    def keep_waves(self, done: np.ndarray) -> None:
        """Keep the waves of the samples of `done` (n,) from their groups' last cycle."""
        for seats, record in zip(self.seats, self.records, strict=False):
            lanes = np.nonzero(done[seats])[0]
            if lanes.size and len(self.waves):
                self.waves[:, seats[lanes]] = record.waves[:, :, lanes].transpose(1, 2, 0)

    def close_ranks(self, live: np.ndarray) -> None:
        """Move the samples of `live` (n,) into as few groups as possible; lanes are identical, so no number changes."""
        places = [(k, int(lane)) for k, seats in enumerate(self.seats) for lane in np.nonzero(live[seats])[0]]
        needed = -(-len(places) // LANES)
        if needed == len({k for k, _ in places}):
            return
        parts = [places[k * LANES : (k + 1) * LANES] for k in range(needed)]
        seats = [np.array([self.seats[k][lane] for k, lane in part]) for part in parts]
        self.groups, self.seats = [gather_lanes(self.groups, part) for part in parts], seats
