"""How much light things send back: drawn for each object, for paint and clothes are not in a mesh."""

import numpy as np

from zbuf_occlude.arrays import FloatArray

ALBEDOS = (0.05, 0.8)
"""From dark paint to light paint at the 905 nm of LiDARs, assumed; between them every factor is as likely."""
TYPICAL = 0.2
"""The middle of them, of objects of which nothing is drawn."""


def draw_albedos(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw albedos (n,), their logarithms uniform over `ALBEDOS`."""
    low, high = ALBEDOS
    return np.asarray(low * (high / low) ** rng.random(n))
