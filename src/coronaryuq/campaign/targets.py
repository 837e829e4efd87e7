"""The jobs of a campaign: division of its counts into portions, and the portions required for a number of runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from coronaryuq.config import Campaign

Portions = dict[int, tuple[int, int]]
"""Index of a portion → its first sample and its number of samples."""


def portions(total: int, size: int) -> Portions:
    """Split `total` samples into portions of `size`; more samples only add portions at the end or fill the last one."""
    return {k: (k * size, min(size, total - k * size)) for k in range(-(-total // size))}


def within(cut: Portions, total: int) -> list[int]:
    """Return the indices of the portions that contain the first `total` samples."""
    return [k for k, (first, _) in cut.items() if first < total]


@dataclass(frozen=True)
class Targets:
    """Jobs of a campaign with this configuration.

    With adaptive allocation, inputs are drawn for the largest number of runs that is allowed; after each round a
    checkpoint decides how many of them are run.
    """

    campaign: Campaign

    @cached_property
    def grows(self) -> bool:
        """Whether a checkpoint decides how many samples are run."""
        estimation = self.campaign.estimation
        return bool(estimation.target_half_width and (estimation.max_3d or estimation.max_0d))

    @cached_property
    def first_counts(self) -> dict[str, int]:
        """3D and 0D runs of the first round."""
        return {"n_3d": self.campaign.samples.n_3d, "n_0d": self.campaign.samples.n_0d}

    @cached_property
    def most(self) -> dict[str, int]:
        """Maximum number of 3D and 0D runs of a growing campaign."""
        if not self.grows:
            return self.first_counts
        bounds = {"n_3d": self.campaign.estimation.max_3d, "n_0d": self.campaign.estimation.max_0d}
        return {name: max(count, bounds[name] or 0) for name, count in self.first_counts.items()}

    @cached_property
    def coarse_runs(self) -> int:
        """Runs on the coarse level for each 3D run; 0 without that level."""
        return self.campaign.flow3d.coarse.runs_per_fine

    @cached_property
    def coarse_tables(self) -> tuple[str, ...]:
        """Tables of runs that exist only with a coarse level."""
        return ("params_coarse", "outputs_3d_coarse", "outputs_0d_coarse") if self.coarse_runs else ()

    @cached_property
    def counts(self) -> dict[str, int]:
        """Size of both tables of inputs.

        The coarse level runs the pilot's inputs and continues in the same table, as a larger pilot would.
        """
        return {"pilot": self.most["n_3d"] * max(1, self.coarse_runs), "propagation": self.most["n_0d"]}

    @cached_property
    def realisations(self) -> Portions:
        """Portions of the noisy perfusion realisations."""
        return portions(self.campaign.perfusion.realisations, self.campaign.samples.chunk_realisations)

    @cached_property
    def batches(self) -> Portions:
        """Batches of 3D runs on the campaign's mesh."""
        return portions(self.most["n_3d"], self.campaign.samples.batch_3d)

    @cached_property
    def coarse_batches(self) -> Portions:
        """Batches of runs on the coarse level."""
        return portions(self.most["n_3d"] * self.coarse_runs, self.campaign.samples.batch_3d)

    @cached_property
    def chunks(self) -> dict[str, Portions]:
        """Chunks of 0D runs of both tables of inputs."""
        return {name: portions(count, self.campaign.samples.chunk_0d) for name, count in self.counts.items()}

    @cached_property
    def shares(self) -> range:
        """Jobs that share the 0D runs at resampled inputs; none without autoencoders."""
        return range(self.campaign.samples.chunks_resampled if self.campaign.estimation.autoencoder else 0)

    def needed(self, counts: Mapping[str, int]) -> dict[str, list[int]]:
        """Return the portions of 3D, coarse and 0D runs that contain the first `counts` runs."""
        coarse = self.coarse_runs * counts["n_3d"]
        return {
            "flow3d": within(self.batches, counts["n_3d"]),
            "coarse": within(self.coarse_batches, coarse),
            "zerod_pilot": within(self.chunks["pilot"], max(coarse, counts["n_3d"])),
            "zerod_propagation": within(self.chunks["propagation"], counts["n_0d"]),
        }
