"""Point clouds for the interactive viewer of the HTML pages: the script, and how its data are packed."""

import base64
import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import as_vectors


@cache
def viewer_script() -> str:
    """Return the viewer's JavaScript, to be put into a ``<script>`` of the page; it defines the class CloudViewer."""
    return asset("cloud_viewer.js")


def asset(name: str) -> str:
    """Return the text of a file of ``zbuf_occlude/assets``."""
    return (files("zbuf_occlude") / "assets" / name).read_text(encoding="utf-8")


def pack_cloud(
    positions: ArrayLike,
    *,
    centre: ArrayLike,
    longest: float,
    normals: ArrayLike | None = None,
    codes: ArrayLike | None = None,
    palette: list[tuple[int, int, int]] | None = None,
    emphasis: list[int] | None = None,
) -> dict[str, Any]:
    """Pack a cloud as the viewer reads it; ``json_for_page`` puts it into a page.

    Parameters
    ----------
    positions : (n, 3) float
        World space.
    centre : (3,) float
    longest : float
        The object's longest side; a position may lie at most so far from the centre.
    normals : (n, 3) float, optional
        Unit normals of either sign.
    codes : (m,) int, optional
        Index into `palette` for each point; where m < n only the first m points are shown.
    palette : list of (r, g, b) in 0..255
    emphasis : list of int
        Codes that are drawn larger, unshaded and over the others.

    Returns
    -------
    dict
        n, positions (int16, step longest / 32767), normals (int8), codes (uint8), palette, emphasis; arrays as base64.
    """
    positions = as_vectors(positions, "positions")
    shorts = np.clip(np.round((positions - np.asarray(centre)) / longest * 32767.0), -32767, 32767).astype("<i2")
    return {
        "n": len(positions),
        "positions": _base64(shorts),
        "normals": None if normals is None else _base64(np.round(np.asarray(normals) * 127.0).astype(np.int8)),
        "codes": None if codes is None else _base64(np.asarray(codes).astype(np.uint8)),
        "palette": [(61, 111, 180)] if palette is None else palette,
        "emphasis": emphasis or [],
    }


def coloured(codes: ArrayLike, palette: Sequence[Sequence[int]]) -> dict[str, Any]:
    """Return codes (n,) and their palette as the viewer reads them, to be put over those of a packed cloud."""
    return {"codes": _base64(np.asarray(codes).astype(np.uint8)), "palette": [list(colour) for colour in palette]}


def json_for_page(document: Any) -> str:
    """Return JSON that may stand inside a ``<script>`` element, whatever texts it holds."""
    return json.dumps(document, separators=(",", ":")).replace("<", "\\u003c")


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
