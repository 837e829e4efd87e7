"""DREAM: differential evolution adaptive Metropolis, vectorised over chains."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.posterior.sampler.boundary import into_box
from coronaryuq.posterior.sampler.proposals import Proposal, differential_evolution, snooker
from coronaryuq.posterior.settings import DreamSettings

OUTLIER_CHECKS = 10
Target = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
Map = Callable[[np.ndarray], np.ndarray]


@dataclass
class State:
    """Everything that the next generations depend on, as arrays, so that a checkpoint consists of these arrays.

    generation: proposals made so far. position (chains, d), log_density (chains,), output (chains, k): what the target
    returned there. crossover: probability of each crossover value; jumped, used: its summed normalised squared jumps
    and number of uses. recent, looks: log densities summed since the last check for outliers, and their number.
    log_weight (chains,): log of the target's over the emulator's density at the last proposal; nan without an emulator.
    accepted, proposed: moves since burn-in ended. screen_accepted, screen_proposed: the same on the emulator.
    evaluations: target evaluations so far. outliers: chains restarted.
    """

    generation: np.ndarray
    position: np.ndarray
    log_density: np.ndarray
    output: np.ndarray
    log_weight: np.ndarray
    crossover: np.ndarray
    jumped: np.ndarray
    used: np.ndarray
    recent: np.ndarray
    looks: np.ndarray
    accepted: np.ndarray
    proposed: np.ndarray
    screen_accepted: np.ndarray
    screen_proposed: np.ndarray
    evaluations: np.ndarray
    outliers: np.ndarray

    def arrays(self) -> dict[str, np.ndarray]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


class Dream:
    """DREAM (Vrugt et al. 2009), exact after burn-in, with an optional emulator that screens proposals.

    One generation, for chains x_1..x_n in d dimensions with target density p:

    1. The chains are split at random into two halves. Each half moves in turn, its partners taken from the other
       half. (All chains moving at once with partners among themselves, as often programmed, does not leave the
       product of the targets invariant; alternating halves do: Foreman-Mackey et al. 2013, section 3.)
    2. Chain i draws a number of pairs delta from 1..`pairs`, that many pairs (a, b) of distinct partners, and a
       crossover value CR from {1/m, ..., 1} with its current probability. Each coordinate is updated with
       probability CR, at least one; d' is their number. On those coordinates the proposal is

           z = x_i + (1 + e) gamma sum_j (x_a(j) - x_b(j)) + eps,    gamma = 2.38 / sqrt(2 delta d'),

       e uniform in (-b, b), eps normal with standard deviation b*. With probability `unit_jump`, gamma is 1.
    3. With probability `snooker` instead: z = x_i + g P (x_b - x_c), P the projection on x_i - x_a, g uniform in
       (1.2, 2.2); the ratio of step 5 gets the factor (|z - x_a| / |x_i - x_a|)^(d - 1) (ter Braak & Vrugt 2008).
    4. Outside a box: reflected or folded back, which keeps the proposal symmetric (snooker: rejected).
    5. Accepted with probability min(1, p(z) / p(x_i)).
    6. During burn-in only: the probability of each CR becomes proportional to the mean squared jump, normalised by
       the spread of the chains, that it has achieved; at ten checks a chain whose mean log density since the last
       check lies below the first quartile of all chains by more than twice the interquartile range restarts from
       the best chain. After burn-in nothing adapts, so detailed balance holds.

    With an emulator q of p (`screen`), a half makes `every` generations of steps 2 to 5 on q, from x to y, and then y
    is accepted with probability min(1, p(y) q(x) / (p(x) q(y))): a reversible kernel of q as the proposal for p (Liu
    2001, section 9.4.3; with `every` = 1 delayed acceptance, Christen & Fox 2005). Draws follow p exactly, however poor
    q is; a poor q only lowers the acceptance. One state is recorded for each such decision.

    Random numbers depend on `seed` and the generation only, so a run that continues from a saved `State` gives the same
    bits.

    Parameters
    ----------
    target
        Takes x (n, d), returns log density (n,), -inf outside its support, and outputs (n, k) carried along with the
        state; a row's values must not depend on the other rows.
    settings, seed
        Settings of the sampler and its seed.
    screen
        Log density (n,) of the emulator q at x (n, d), up to a constant.
    every
        Generations on the emulator between two decisions of the target.
    box
        Bounds (2, d), or None.
    adjust
        Maps accepted states to others, whose density is then evaluated again: it reproduces the paper's rescaling and
        makes the chain inexact.

    length
        What follows burn-in, over what follows it in chains of `settings.generations`. Burn-in does not depend on it,
        so chains that are made longer later are, to the bit, those made so at once.

    References
    ----------
    Vrugt et al., Int. J. Nonlinear Sci. Numer. Simul. 10, 2009; ter Braak and Vrugt, Stat. Comput. 18, 2008;
    Foreman-Mackey et al., PASP 125, 2013; Liu, Monte Carlo Strategies in Scientific Computing, 2001; Christen and Fox,
    J. Comput. Graph. Stat. 14, 2005.
    """

    def __init__(
        self, target: Target, settings: DreamSettings, seed: int, *, screen: Map | None = None, every: int = 1,
        box: np.ndarray | None = None, adjust: Map | None = None, length: int = 1,
    ):  # fmt: skip
        self.target, self.settings, self.seed, self.screen, self.box, self.adjust = (
            target, settings, seed, screen, box, adjust,
        )  # fmt: skip
        self.every = every if screen is not None else 1
        first = -(-settings.generations // self.every)
        self.burn_in = int(round(settings.burn_in * first))
        self.decisions = self.burn_in + length * (first - self.burn_in)

    def start(self, position: np.ndarray, evaluated: tuple[np.ndarray, np.ndarray] | None = None) -> State:
        """Return the state before the first generation; `position` (chains, d) must lie in the support."""
        position = np.array(position, dtype=float)
        log_density, output = self.target(position) if evaluated is None else evaluated
        if not np.all(np.isfinite(log_density)):
            raise ValueError("a chain starts outside the support of its target")
        n, m = len(position), self.settings.crossovers
        return State(
            generation=np.array(0), position=position, log_density=np.array(log_density), output=np.array(output),
            log_weight=np.full(n, np.nan), crossover=np.full(m, 1.0 / m), jumped=np.zeros(m), used=np.zeros(m),
            recent=np.zeros(n), looks=np.array(0),
            accepted=np.zeros(n), proposed=np.array(0), screen_accepted=np.zeros(n), screen_proposed=np.array(0),
            evaluations=np.array(n if evaluated is None else 0), outliers=np.array(0),
        )  # fmt: skip

    def advance(self, state: State) -> None:
        """Make one decision of the target: `every` generations with an emulator, one without. Changes `state`."""
        random = generator(self.seed, "dream", "generation", int(state.generation))
        decision = int(state.generation) // self.every
        adapting = decision < self.burn_in
        self._count_from_here(state, decision)
        order = random.permutation(len(state.position))
        half = len(order) // 2
        for movers, partners in ((order[:half], order[half:]), (order[half:], order[:half])):
            self.move(state, movers, state.position[partners], random)
        self._decided(state)
        if adapting:
            self._adapt(state, decision)

    def _count_from_here(self, state: State, decision: int) -> None:
        """Start counting moves when burn-in ends."""
        if decision == self.burn_in:
            state.accepted[:], state.proposed, state.screen_accepted[:] = 0, np.array(0), 0
            state.screen_proposed = np.array(0)

    def _decided(self, state: State) -> None:
        state.generation = state.generation + self.every
        state.proposed = state.proposed + 1
        state.screen_proposed = state.screen_proposed + self.every

    def move(self, state: State, movers: np.ndarray, pool: np.ndarray, random: np.random.Generator) -> None:
        """Move one half of the chains, indices `movers`, with partners at `pool` (m, d). Changes `state`."""
        spread = state.position.std(axis=0)
        before = state.position[movers]
        if self.screen is not None:
            after, here, there, moved = self._screened(state, movers, pool, spread, random)
            self._decide(state, movers, after, here, there, moved, random)
            return
        proposal = self._propose(before, pool, state.crossover, random)
        zero = np.zeros(len(movers))
        accept = self._decide(state, movers, proposal.position, proposal.log_ratio, zero, zero == 0, random)
        self._credit(state, proposal, np.where(accept[:, None], proposal.position - before, 0.0), spread)

    def _decide(self, state, movers, after, here, there, moved, random) -> np.ndarray:
        """Run the target at `after` where it `moved`; return who goes there. here, there: log density of proposing."""
        threshold = np.log(random.uniform(size=len(movers)))
        log_density = np.full(len(movers), -np.inf)
        output = state.output[movers]
        if np.any(moved):
            log_density[moved], output[moved] = self.target(after[moved])
            state.evaluations = state.evaluations + int(moved.sum())
        if self.screen is not None:
            state.log_weight[movers] = np.where(moved, log_density, state.log_density[movers]) - there
        with np.errstate(invalid="ignore"):
            accept = moved & (threshold < log_density - state.log_density[movers] + here - there)
        if self.adjust is not None and np.any(accept):
            after[accept] = self.adjust(after[accept])
            log_density[accept], output[accept] = self.target(after[accept])
            state.evaluations = state.evaluations + int(accept.sum())
        chosen = movers[accept]
        state.position[chosen] = after[accept]
        state.log_density[chosen] = log_density[accept]
        state.output[chosen] = output[accept]
        state.accepted[chosen] += 1
        return accept

    def _screened(self, state, movers, pool, spread, random):
        """`every` generations on the emulator; returns where they led, log q(x), log q(y), and who moved."""
        position = state.position[movers].copy()
        first = current = self.screen(position)
        moved = np.zeros(len(movers), dtype=bool)
        for _ in range(self.every):
            proposal = self._propose(position, pool, state.crossover, random)
            there = self.screen(proposal.position)
            with np.errstate(invalid="ignore"):
                accept = np.log(random.uniform(size=len(movers))) < there - current + proposal.log_ratio
            step = np.where(accept[:, None], proposal.position - position, 0.0)
            self._credit(state, proposal, step, spread)
            position = np.where(accept[:, None], proposal.position, position)
            current = np.where(accept, there, current)
            state.screen_accepted[movers] += accept
            moved |= accept
        return position, first, current, moved

    def _propose(self, position, pool, crossover, random) -> Proposal:
        proposal = differential_evolution(position, pool, crossover, self.settings, random)
        if self.settings.snooker > 0:
            by_snooker = random.uniform(size=len(position)) < self.settings.snooker
            proposal = proposal.replaced(by_snooker, snooker(position, pool, random))
        if self.box is not None:
            proposal = into_box(proposal, self.box, self.settings.boundary)
        return proposal

    def _credit(self, state, proposal, step, spread) -> None:
        if not self.settings.adapt_crossovers or int(state.generation) // self.every >= self.burn_in:
            return
        jump = np.sum((step / np.where(spread > 0, spread, 1.0)) ** 2, axis=1)
        crossed = proposal.crossover >= 0
        values = len(state.crossover)
        state.jumped += np.bincount(proposal.crossover[crossed], weights=jump[crossed], minlength=values)
        state.used += np.bincount(proposal.crossover[crossed], minlength=values)

    def _adapt(self, state: State, decision: int) -> None:
        if self.settings.adapt_crossovers and np.all(state.used > 0) and state.jumped.sum() > 0:
            mean_jump = state.jumped / state.used
            share = np.maximum(mean_jump / mean_jump.sum(), 0.1 / len(mean_jump))
            state.crossover = share / share.sum()
        state.recent += state.log_density
        state.looks = state.looks + 1
        interval = max(self.burn_in // OUTLIER_CHECKS, 1)
        if self.settings.remove_outliers and (decision + 1) % interval == 0:
            mean = state.recent / state.looks
            low, high = np.quantile(mean, [0.25, 0.75])
            outlying, best = mean < low - 2.0 * (high - low), int(np.argmax(mean))
            for array in (state.position, state.log_density, state.output):
                array[outlying] = array[best]
            state.outliers = state.outliers + int(outlying.sum())
            state.recent, state.looks = np.zeros(len(mean)), np.array(0)
