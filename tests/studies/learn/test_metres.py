"""Classifiers of clouds in metres: sizes are kept, and decide; clouds that have lost theirs are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from zbuf_occlude import ArgumentError  # noqa: E402  (need torch)
from zbuf_occlude.datasets.generate import generate  # noqa: E402
from zbuf_occlude.datasets.plan import DatasetConfig, Plan  # noqa: E402
from zbuf_occlude.meshes import shapes  # noqa: E402
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds  # noqa: E402
from zbuf_occlude.studies.learn.evaluation import evaluate, predict  # noqa: E402
from zbuf_occlude.studies.learn.networks import Classifier, PointNet, SphereClassifier, VoxNet  # noqa: E402
from zbuf_occlude.studies.learn.training import TrainConfig, train  # noqa: E402

SIDES = (1.0, 4.0)


def cubes(n_clouds: int, seed: int, scale: str = "metres") -> CloudSet:
    """Small and large cubes, which only their sides, 1 and 4 m within 10 %, tell apart."""
    rng, labels = np.random.default_rng(seed), np.arange(n_clouds) % 2
    points = rng.uniform(-0.5, 0.5, (n_clouds, 64, 3))
    sides = np.array(SIDES)[labels] * rng.uniform(0.9, 1.1, n_clouds)
    positions = points * (sides[:, None, None] if scale == "metres" else 1.0)
    unknown = np.full(n_clouds, np.nan)
    return CloudSet(positions, labels, ("small", "large"), np.arange(n_clouds), unknown, scale=scale)


@pytest.mark.parametrize("network", [Classifier(2), SphereClassifier(2)])
def test_one_length_becomes_1_in_all_clouds(network: Classifier) -> None:
    clouds = torch.from_numpy(cubes(6, 0).positions)
    own = network.normalise(clouds)
    assert torch.allclose(network.extents(own), torch.ones(6, 1, 1))
    network.keep_sizes(clouds)
    kept = network.normalise(clouds + 5.0)
    sizes = network.extents(network.centred(clouds))
    assert torch.allclose(network.extents(kept), sizes / sizes.amax(), atol=1e-5)
    assert torch.allclose(kept * sizes.amax(), network.centred(clouds), atol=1e-5)


def test_sizes_decide_where_shapes_do_not(tmp_path: Path) -> None:
    config = TrainConfig("voxnet", epochs=8, batch_size=8, seed=1)
    trained = train(config, cubes(48, 1), cubes(16, 2), tmp_path / "metres")
    assert evaluate(trained.model, cubes(40, 3)).accuracy == 1.0
    assert trained.predict(cubes(1, 4).positions[0]) == "small"
    assert trained.predict(4.0 * cubes(1, 4).positions[0]) == "large"
    assert evaluate(trained.model, replace(cubes(40, 3), scale="mesh")).accuracy == 1.0, "as crops in files are"
    with pytest.raises(ArgumentError, match="clouds must be in metres, as those of the training; their scale is cloud"):
        predict(trained.model, cubes(4, 3, scale="cloud"))
    blind = train(config, cubes(48, 1, scale="cloud"), cubes(16, 2, scale="cloud"), tmp_path / "cloud")
    assert evaluate(blind.model, cubes(40, 3)).accuracy < 0.9


def test_augmentation_keeps_sizes() -> None:
    """Noise is a share of each cloud's own size; there is no scaling by 0.8 to 1.25."""
    cloud = torch.from_numpy(cubes(2, 0, scale="cloud").positions[0])
    changed = [TrainConfig(rotate=False).augmentation("metres")(cloud) for _ in range(20)]
    assert max(float((each - cloud).abs().max()) for each in changed) <= 0.05 + 1e-6
    scaled = [TrainConfig(rotate=False, jitter=False).augmentation("cloud")(cloud) for _ in range(20)]
    assert max(float((each - cloud).abs().max()) for each in scaled) > 0.05


def test_metres_are_not_mixed_with_scaled_clouds(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="both sets must be in metres; their scales are metres and cloud"):
        CloudSet.concatenate(cubes(4, 0), cubes(4, 0, scale="cloud"))
    assert CloudSet.concatenate(cubes(4, 0), replace(cubes(4, 0), scale="mesh")).scale == "metres"
    with pytest.raises(ArgumentError, match="validation must be in metres"):
        train(TrainConfig(), cubes(8, 0), cubes(4, 0, scale="cloud"), tmp_path / "model")


def test_the_scale_of_a_dataset_is_known(tmp_path: Path) -> None:
    meshes = shapes.traffic.collection().select(classes=["pedestrian"]).limit(2)
    for scale in ("metres", "cloud"):
        config = DatasetConfig(method="exact", views="ring:2@0", n_points=500, sample_size=32, scale=scale)
        generate(Plan(meshes, config), tmp_path / scale)
        clouds = load_clouds(tmp_path / scale, meshes[0].split)
        assert (clouds.scale, clouds.keeps_size) == (scale, scale == "metres")
        assert (np.ptp(clouds.positions, axis=1).max(axis=1) > 1.05).all() == (scale == "metres")


@pytest.mark.parametrize("network", [VoxNet(2), PointNet(2)])
def test_the_unit_is_stored_with_the_weights(network: Classifier) -> None:
    network.keep_sizes(torch.from_numpy(cubes(6, 0).positions))
    other = type(network)(2)  # type: ignore[arg-type]
    other.load_state_dict(network.state_dict())
    assert float(other.unit) == float(network.unit) > 4.0 * 0.9 * 0.8
