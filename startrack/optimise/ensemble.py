"""Log-probability -> samples and their convergence diagnostics (emcee)."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from startrack.core import Floats, Refused, printed, whole
from startrack.optimise.ledger import Ledger

if TYPE_CHECKING:
    import emcee

LONG_ENOUGH = 50  # autocorrelation times; emcee's documentation, "Autocorrelation analysis"
# Independent samples of each variable, and split R-hat: Vehtari et al. (2021), Bayesian Analysis
# 16, 667, section 4.
FEWEST = 400
FARTHEST = 1.01
# Accepted fraction of the moves. Chosen by hand, a wide range around the 0.2 to 0.5 of
# Foreman-Mackey et al. (2013): below it a chain hardly moves, above it the steps are too small.
LEAST_ACCEPTED, MOST_ACCEPTED = 0.05, 0.95
BURN_IN = 5  # a fifth of the chain is discarded; chosen by hand: bias against number of samples
REPEATS = 12  # evaluations of a random log-probability, to estimate its noise; chosen by hand
# Largest standard deviation of a log-probability that may be sampled. Chosen by hand: above about
# 1, walkers stay for many steps at points whose value is high by chance.
NOISIEST = 1.0
PARTS = ("chain", "log_prob", "accepted", "key", "rest")  # arrays of a stretch in the ledger


@dataclass(frozen=True)
class Ensembles:
    """Settings of the sampling.

    count       number of independent ensembles
    walkers     of each ensemble; None: four per variable, at least 16
    stretch     steps between two checks of the convergence
    most_steps  largest number of steps
    """

    count: int = 4
    walkers: int | None = None
    stretch: int = 1000
    most_steps: int = 20_000

    def __post_init__(self) -> None:
        whole(2, 100, count=self.count)
        whole(100, 10**6, stretch=self.stretch)
        whole(self.stretch, 10**8, most_steps=self.most_steps)


@printed
@dataclass(frozen=True, eq=False)
class Chains:
    """Samples without their burn-in.

    samples          (ensembles, steps, walkers, d)
    acceptance       1, fraction of moves that are accepted, in the ensemble with the least
    autocorrelation  (d,) step, integrated autocorrelation time of each variable
    """

    samples: Floats
    acceptance: float
    autocorrelation: Floats

    @property
    def flat(self) -> Floats:
        """All samples (n, d)."""
        return self.samples.reshape(-1, self.samples.shape[-1])

    @property
    def effective(self) -> Floats:
        """(d,) number of independent samples of each variable."""
        return len(self.flat) / np.maximum(self.autocorrelation, 1)

    @property
    def split_r_hat(self) -> Floats:
        """Standard deviation (d,) of all samples over the one within the halves of ensembles.

            R^2 = (W + B) / W

        W is the mean variance within a half, B the variance of the means of halves.

        Source: Gelman et al. (2013), Bayesian Data Analysis, 11.4, with ensembles in place of
        chains, because the walkers of one ensemble are not independent.
        """
        count, steps, walkers, d = self.samples.shape
        half = steps // 2
        halves = self.samples[:, : 2 * half].reshape(2 * count, half * walkers, d)
        within = halves.var(axis=1).mean(axis=0)
        between = halves.mean(axis=1).var(axis=0, ddof=1)
        return np.sqrt(1 + between / np.maximum(within, np.finfo(float).tiny))

    @property
    def reason_unconverged(self) -> str:
        """Why the chains have not converged; empty where they have converged."""
        steps, longest = self.samples.shape[1], float(np.max(self.autocorrelation))
        farthest, fewest = float(np.max(self.split_r_hat)), float(np.min(self.effective))
        times = f"{LONG_ENOUGH} autocorrelation times of {longest:.0f}"
        if not steps >= LONG_ENOUGH * longest:
            return f"{steps} steps are fewer than {times}"
        if not farthest <= FARTHEST:
            return f"the ensembles differ: split R-hat is {farthest:.3f}, above {FARTHEST}"
        if not fewest >= FEWEST:
            return f"{fewest:.0f} independent samples are fewer than {FEWEST}"
        if not LEAST_ACCEPTED <= self.acceptance <= MOST_ACCEPTED:
            return f"{self.acceptance:.2f} of the moves were accepted"
        return ""

    @property
    def converged(self) -> bool:
        """Whether all criteria of convergence are met."""
        return not self.reason_unconverged


def draw(
    log_probability: Callable[[Floats], Floats],
    start: Callable[[np.random.Generator, int], Floats],
    seed: int,
    settings: Ensembles | None = None,
    ledger: Ledger | None = None,
) -> Chains:
    """Sample a density in independent ensembles of walkers, by two moves of emcee.

    Four fifths of the moves are differential evolution (ter Braak 2006, Statistics and Computing
    16, 239). One fifth are stretch moves (Goodman and Weare 2010, Communications in Applied
    Mathematics and Computational Science 5, 65).

    log_probability  (n, d) -> (n,), minus infinity outside the support
    start            starting points (n, d) of n walkers; split R-hat needs them to be wider than
                     the density
    ledger           keeps each stretch, so that interrupted sampling continues
    Raises           Refused if the log-probability of a start is NaN or minus infinity, or where
                     it is random with a standard deviation above 1. Other failures are in
                     `Chains.reason_unconverged`.
    Accuracy         statistical: an estimate of the density with less noise gives the right
                     distribution if it is unbiased (Andrieu and Roberts 2009), because emcee
                     evaluates it once for each position of a walker.
    """
    settings = settings or Ensembles()
    chains = [
        _Ensemble(log_probability, start, (seed, number), settings, ledger or Ledger())
        for number in range(settings.count)
    ]
    while True:
        for chain in chains:
            chain.walk()
        result = _result([chain.sampler for chain in chains])
        if result.converged or chains[0].sampler.iteration >= settings.most_steps:
            return result


def _result(samplers: list[emcee.EnsembleSampler]) -> Chains:
    discard = samplers[0].iteration // BURN_IN
    times = [sampler.get_autocorr_time(discard=discard, tol=0, quiet=True) for sampler in samplers]
    autocorrelation = np.mean(times, axis=0)
    # A variable that never moved has no autocorrelation time.
    autocorrelation = np.where(np.isfinite(autocorrelation), autocorrelation, np.inf)
    return Chains(
        np.array([sampler.get_chain(discard=discard) for sampler in samplers]),
        min(float(np.mean(sampler.acceptance_fraction)) for sampler in samplers),
        autocorrelation,
    )


class _Ensemble:
    """One ensemble of walkers, whose steps the ledger keeps."""

    def __init__(
        self,
        log_probability: Callable[[Floats], Floats],
        start: Callable[[np.random.Generator, int], Floats],
        entropy: tuple[int, int],
        settings: Ensembles,
        ledger: Ledger,
    ) -> None:
        import emcee  # costs 0.9 s, and only sampling needs it

        sequence = np.random.SeedSequence(entropy)
        rng = np.random.default_rng(sequence)
        d = start(rng, 1).shape[1]
        walkers = settings.walkers or max(16, 4 * d)
        points = start(rng, walkers)
        first = log_probability(points)
        if np.isnan(first).any():
            raise Refused("the log-probability must not be NaN at the start")
        if not np.isfinite(first).all():
            raise Refused("the log-probability must be finite where the walkers start")
        _refuse_noise(log_probability, points, first)
        # emcee needs numpy's older generator; each ensemble has its own.
        state = np.random.RandomState(np.random.MT19937(sequence)).get_state()
        # Trap: emcee 3.1.6's DESnookerMove does not keep the density; a variance falls by 15 %.
        moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
        self.sampler = emcee.EnsembleSampler(
            walkers, d, log_probability, moves=moves, vectorize=True
        )
        self.sampler.log_prob_fn = log_probability  # emcee's own prints the traceback of a signal
        self._at = emcee.State(points, log_prob=first, random_state=state)
        self._settings, self._ledger = settings, ledger
        # The key identifies the density by its values at the starting points.
        name = repr((entropy, settings, points.tobytes(), first.tobytes()))
        self._key = hashlib.blake2b(name.encode(), digest_size=16).digest()
        self._done = 0

    def walk(self) -> None:
        """Add one stretch: from the ledger, or else by new steps."""
        packed = self._ledger.stretch(self._key, self._done)
        if packed is None:
            self._at = self.sampler.run_mcmc(self._at, self._settings.stretch)
            self._ledger.keep_stretch(self._key, self._done, self._packed())
        else:
            self._unpack(packed)
        self._done += 1

    def _packed(self) -> bytes:
        size = self._settings.stretch
        _, key, position, has_gauss, gauss = self._at.random_state
        file = io.BytesIO()
        np.savez(
            file,
            chain=self.sampler.get_chain()[-size:],
            key=key,
            log_prob=self.sampler.get_log_prob()[-size:],
            accepted=self.sampler.backend.accepted,
            rest=np.array([position, has_gauss, gauss]),
        )
        return file.getvalue()

    def _unpack(self, packed: bytes) -> None:
        import emcee

        with np.load(io.BytesIO(packed), allow_pickle=False) as file:
            stretch = {name: file[name] for name in PARTS}
        backend, size = self.sampler.backend, self._settings.stretch
        if not backend.initialized:
            backend.reset(self.sampler.nwalkers, self.sampler.ndim)
        backend.grow(size, None)
        backend.chain[backend.iteration :] = stretch["chain"]
        backend.log_prob[backend.iteration :] = stretch["log_prob"]
        backend.accepted = stretch["accepted"]
        backend.iteration += size
        position, has_gauss, gauss = stretch["rest"]
        state = ("MT19937", stretch["key"], int(position), int(has_gauss), float(gauss))
        backend.random_state = state
        self._at = emcee.State(
            stretch["chain"][-1], log_prob=stretch["log_prob"][-1], random_state=state
        )


def _refuse_noise(log_probability: Callable[[Floats], Floats], at: Floats, first: Floats) -> None:
    if np.array_equal(log_probability(at), first):
        return
    noise = float(np.max(np.std([log_probability(at) for _ in range(REPEATS)], axis=0, ddof=1)))
    if not noise <= NOISIEST:
        raise Refused(
            f"the log-probability must not be noisier than {NOISIEST:g}, got a standard deviation "
            f"of {noise:.2g}; sample with more trials"
        )


def median_and_interval(column: Floats, fraction: float) -> tuple[float, float, float]:
    """Median of samples (n,), and the ends of the central interval that holds a fraction."""
    low, middle, high = np.quantile(column, [(1 - fraction) / 2, 0.5, (1 + fraction) / 2])
    return float(middle), float(low), float(high)


def thinned(samples: Floats, count: int) -> Floats:
    """`count` of the samples (n, d), evenly spaced."""
    return samples[np.linspace(0, len(samples) - 1, min(count, len(samples))).astype(int)]
