"""What is packed for the interactive viewer comes back, and cannot break out of its page."""

import base64
import json

import numpy as np

from zbuf_occlude.drawing.pages import json_for_page, pack_cloud


def test_positions_come_back_to_half_a_step() -> None:
    positions = np.random.default_rng(0).uniform(-3, 7, (50, 3))
    cloud = pack_cloud(positions, centre=[2, 2, 2], longest=10.0, codes=np.arange(50) % 4)
    shorts = np.frombuffer(base64.b64decode(cloud["positions"]), dtype="<i2").reshape(-1, 3)
    assert np.abs(shorts / 32767 * 10.0 + 2.0 - positions).max() <= 0.5 * 10.0 / 32767 + 1e-12
    assert np.frombuffer(base64.b64decode(cloud["codes"]), np.uint8).tolist() == [i % 4 for i in range(50)]
    assert cloud["normals"] is None
    assert cloud["n"] == 50


def test_json_for_a_page_cannot_end_its_script() -> None:
    text = json_for_page({"name": "</script><script>alert(1)"})
    assert "<" not in text
    assert json.loads(text) == {"name": "</script><script>alert(1)"}
