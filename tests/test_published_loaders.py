"""benchmarks/published_loaders.py: what it finds right and wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import published_loaders as script  # noqa: E402
from published_readers import Item  # noqa: E402

pytestmark = pytest.mark.needs("open3d")

PCN = next(loader for loader in script.LOADERS if loader.layout == "pcn")


@pytest.fixture(scope="module")
def surfaces(tmp_path_factory: pytest.TempPathFactory) -> list[script.Surface]:
    return [script.Surface(made) for made in script.make_meshes("shapenet", tmp_path_factory.mktemp("meshes"))[:6]]


def test_a_right_item_is_found_right_and_wrong_ones_wrong(surfaces: list[script.Surface]) -> None:
    one, other = surfaces[0].made, surfaces[3].made
    whole = surfaces[0].samples
    seen = whole[surfaces[0].seen(whole, surfaces[0].eyes(PCN.n_views)[2], 1e-6)]
    partial, complete = ((points - one.centre) / one.longest for points in (seen, whole))

    def said(partial: np.ndarray = partial, label: str = one.label, split: str = "train", key: str = one.key) -> str:
        return script.check_item(Item(split, label, partial, complete, key), PCN, surfaces)

    assert said() == ""
    assert said(partial * [-1, 1, 1])  # not with its complete cloud
    assert "lies on no mesh" in said(partial[:, [0, 2, 1]] * [1, 1, -1])
    assert "hidden from every camera" in said(complete)
    assert "its mesh" in said(label="table")
    assert "its mesh" in said(split="test")
    assert "it lies on" in said(key=other.key)
