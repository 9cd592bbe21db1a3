"""What a sample says of the whole: the exact interval of a share, from how many of a random few are wrong."""

import numpy as np

CONFIDENCE = 0.95


def interval(n_wrong: int, n: int) -> tuple[float, float]:
    """Return the interval that holds the true share with `CONFIDENCE`, whatever it is.

    Parameters
    ----------
    n_wrong : int
        Of `n` answers drawn at random; answers of one mesh or view may err together, which is not taken into account.
    n : int

    References
    ----------
    C. J. Clopper, E. S. Pearson: The use of confidence or fiducial limits illustrated in the case of the binomial.
    Biometrika 26 (1934), doi:10.1093/biomet/26.4.404.
    """
    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if n_wrong == 0 else _share_of_tail(n_wrong - 1, n, 1.0 - tail)
    high = 1.0 if n_wrong == n else _share_of_tail(n_wrong, n, tail)
    return low, high


def _share_of_tail(most: int, n: int, probability: float) -> float:
    """Return the share at which at most `most` of `n` are wrong with that probability; by halving."""
    i = np.arange(most)
    log_ways = np.concatenate([[0.0], np.cumsum(np.log(n - i) - np.log(i + 1.0))])  # of choosing 0, 1, ..., most
    wrong = np.arange(most + 1)
    low, high = 0.0, 1.0
    while high - low > 1e-12 * high:
        share = (low + high) / 2.0
        at_most = np.exp(log_ways + wrong * np.log(share) + (n - wrong) * np.log1p(-share)).sum()
        low, high = (share, high) if at_most > probability else (low, share)
    return high
