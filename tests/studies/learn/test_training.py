"""Training: learning, early stop, resuming to the same weights, and refused folders."""

import itertools
import json
import pkgutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude import OptionError  # noqa: E402
from zbuf_occlude.base.errors import ArgumentError, DatasetError, UnavailableError  # noqa: E402
from zbuf_occlude.studies.learn.data import CloudSet  # noqa: E402
from zbuf_occlude.studies.learn.evaluation import evaluate  # noqa: E402
from zbuf_occlude.studies.learn.models import find_model  # noqa: E402
from zbuf_occlude.studies.learn.training import (  # noqa: E402
    CHECKPOINT,
    HISTORY,
    MODEL,
    Epoch,
    TimeUp,
    TrainConfig,
    Trained,
    load_trained,
    train,
)

GradScaler = torch.amp.GradScaler
CONFIG = TrainConfig(epochs=5, batch_size=8, device="cpu")


def boxes(n_clouds: int, seed: int, n_points: int = 40) -> CloudSet:
    """Return flat and tall boxes in turn."""
    rng = np.random.default_rng(seed)
    labels = np.arange(n_clouds) % 2
    sides = np.where(labels[:, None] == 0, [1.0, 0.8, 0.1], [0.3, 0.2, 1.0]) * rng.uniform(0.9, 1.1, (n_clouds, 3))
    positions = (rng.random((n_clouds, n_points, 3)) - 0.5) * sides[:, None]
    return CloudSet(positions, labels, ("flat", "tall"), np.arange(n_clouds), np.full(n_clouds, np.nan))


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Use one thread: the last bits of sums depend on their number."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


SHORT, CLOUDS = replace(CONFIG, epochs=1), (boxes(8, 0), boxes(4, 1))


def weights(trained: Trained) -> dict[str, bytes]:
    return {name: value.numpy().tobytes() for name, value in trained.model.state_dict().items()}


@pytest.mark.parametrize("model", ["voxnet", "pointnet"])
def test_it_learns_and_leaves_what_it_learnt(tmp_path: Path, model: str) -> None:
    before = torch.get_rng_state()
    numbers: list[int] = []
    config = replace(CONFIG, model=model)
    trained = train(config, boxes(24, 0), boxes(8, 1), tmp_path, progress=lambda epoch: numbers.append(epoch.number))
    assert torch.equal(torch.get_rng_state(), before), "the caller's draws are not disturbed"
    assert numbers == [epoch.number for epoch in trained.history]
    assert trained.best.validation_accuracy == 1.0
    assert evaluate(trained.model, boxes(30, 2)).accuracy == 1.0
    assert sorted(path.name for path in tmp_path.iterdir()) == [HISTORY, MODEL]
    document = json.loads((tmp_path / HISTORY).read_text())
    assert TrainConfig(**document["config"]) == config
    assert [epoch["loss"] for epoch in document["history"]] == [epoch.loss for epoch in trained.history]
    again = load_trained(tmp_path, "cpu")
    assert weights(again) == weights(trained)
    assert (again.config, again.classes, again.best) == (config, ("flat", "tall"), trained.best)
    assert not again.model.training


def test_seeds_decide(tmp_path: Path) -> None:
    one, same, other = (
        weights(train(replace(SHORT, seed=seed), *CLOUDS, tmp_path / name))
        for name, seed in (("one", 3), ("same", 3), ("other", 4))
    )
    assert one == same
    assert one != other


def test_it_stops_early_and_keeps_the_first_of_equals(tmp_path: Path) -> None:
    config = replace(CONFIG, epochs=50, patience=3, learning_rate=1e-30)
    trained = train(config, *CLOUDS, tmp_path)
    assert [epoch.number for epoch in trained.history] == [1, 2, 3, 4]
    assert trained.best.number == 1


class Killed(Exception):  # noqa: N818  (no error: an end)
    """Exception that stands for the end of the process."""


@pytest.mark.parametrize(
    ("place", "call", "how", "seconds", "left"),
    [
        ("zbuf_occlude.studies.learn.networks.Classifier.loss", 11, KeyboardInterrupt, 1e9, [4, 5]),
        ("zbuf_occlude.studies.learn.networks.Classifier.loss", 11, Killed, 0.0, [4, 5]),
        ("zbuf_occlude.base.atomic.write_json", 1, KeyboardInterrupt, 1e9, []),
    ],
    ids=["interrupted", "killed", "interrupted while the model is written"],
)
def test_stopped_and_resumed_it_ends_with_the_same_weights(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    call: int,
    how: type[BaseException],
    seconds: float,
    left: list[int],
) -> None:
    """Interrupts in the fourth epoch, after a step has changed the weights, and at the end."""
    undisturbed = train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path / "undisturbed")
    folder, whole, calls = tmp_path / "stopped", pkgutil.resolve_name(place), itertools.count(1)

    def stopped(*given: Any) -> Any:
        if next(calls) == call:
            raise how
        return whole(*given)

    with monkeypatch.context() as patch:
        patch.setattr(place, stopped)
        with pytest.raises(how):
            train(CONFIG, boxes(24, 0), boxes(8, 1), folder, checkpoint_seconds=seconds)
    assert [path.name for path in folder.iterdir()] == [CHECKPOINT]
    with pytest.raises(
        DatasetError, match=rf"it has no {MODEL}. Its training is not finished; run the same command again"
    ):
        load_trained(folder)
    (folder / ".zbuf-0123456789abcdef.part").write_bytes(b"what a kill while writing leaves")
    numbers: list[int] = []
    resumed = train(CONFIG, boxes(24, 0), boxes(8, 1), folder, progress=lambda epoch: numbers.append(epoch.number))
    assert numbers == left, "every epoch that ended is kept"
    assert weights(resumed) == weights(undisturbed)
    assert resumed.history == undisturbed.history
    assert sorted(path.name for path in folder.iterdir()) == [HISTORY, MODEL]


def test_it_stops_where_it_is_told_to_and_continues_there(tmp_path: Path) -> None:
    whole = train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path / "whole")

    def stop(epoch: Epoch) -> None:
        if epoch.number in (2, 5):
            raise TimeUp

    for _ in range(2):
        with pytest.raises(TimeUp):
            train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path / "parts", progress=stop)
        assert [path.name for path in (tmp_path / "parts").iterdir()] == [CHECKPOINT]
    parts = train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path / "parts", progress=stop)
    assert weights(parts) == weights(whole)
    assert parts.history == whole.history


def test_a_training_begun_without_mixed_precision_continues_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Begun on a CPU, continued as on a GPU: with factors that scale the loss."""

    def stop(epoch: Epoch) -> None:
        if epoch.number == 1:
            raise TimeUp

    with pytest.raises(TimeUp):
        train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path, progress=stop)
    scalers = []

    def scaling(device: str, enabled: bool) -> Any:
        assert not enabled
        scalers.append(GradScaler(device, enabled=True))
        return scalers[0]

    monkeypatch.setattr("torch.amp.GradScaler", scaling)
    assert len(train(CONFIG, boxes(24, 0), boxes(8, 1), tmp_path, progress=stop).history) == 5
    assert len(scalers) == 1
    assert scalers[0].state_dict()["_growth_tracker"] == 12, "steps of four epochs"


def test_a_training_that_is_done_is_returned_and_another_refused(tmp_path: Path) -> None:
    trained = train(SHORT, *CLOUDS, tmp_path)
    numbers: list[int] = []
    again = train(SHORT, *CLOUDS, tmp_path, progress=lambda epoch: numbers.append(epoch.number))
    assert weights(again) == weights(trained)
    assert numbers == []
    for other, different in (
        ((replace(SHORT, seed=1, n_points=40), *CLOUDS), "seed, n_points"),
        ((SHORT, boxes(8, 5), CLOUDS[1]), "clouds"),
        ((SHORT, CLOUDS[0], CLOUDS[0]), "clouds"),
    ):
        said = rf"must be empty or hold this same training; it holds one with other {different}\. Choose"
        with pytest.raises(DatasetError, match=said):
            train(*other, tmp_path)


def test_augmentation_is_seen_by_the_network(tmp_path: Path) -> None:
    switches = {"rotate": False, "rescale": False, "jitter": False}
    plain = weights(train(replace(SHORT, **switches), *CLOUDS, tmp_path / "plain"))
    for name in switches:
        changed = train(replace(SHORT, **{**switches, name: True}), *CLOUDS, tmp_path / name)
        assert weights(changed) != plain, name


@pytest.mark.parametrize("model", ["voxnet", "pointnet", "threedmfv5"])
def test_half_precision_is_near_the_full_one(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mixed precision on a CPU has the dtypes of CUDA; the loss is nearly the same."""
    monkeypatch.setattr("zbuf_occlude.studies.learn.networks.SMALL", 0)  # CUDA takes torch's convolution
    torch.manual_seed(0)
    network = find_model(model).build(2)
    points = network.normalise(torch.from_numpy(boxes(4, 0).positions))
    labels = torch.tensor([0, 1, 0, 1])
    network.train()
    for layer in network.modules():
        if isinstance(layer, torch.nn.Dropout):
            layer.p = 0.0
    full = network.loss(points, labels)
    with torch.autocast("cpu", torch.bfloat16):
        half = network.loss(points, labels)
    half.backward()
    assert abs(float(half.detach()) - float(full.detach())) < 0.05
    assert all(torch.isfinite(p.grad).all() for p in network.parameters())


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@pytest.mark.parametrize("model", ["voxnet", "pointnet", "threedmfv5"])
def test_cuda_in_mixed_precision_learns_too(tmp_path: Path, model: str) -> None:
    config = TrainConfig(model=model, epochs=5, batch_size=8, device="cuda")
    trained = train(config, boxes(24, 0), boxes(8, 1), tmp_path)
    assert next(trained.model.parameters()).is_cuda
    assert evaluate(trained.model, boxes(30, 2)).accuracy == 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epochs": 0}, "epochs must be at least 1; got 0"),
        ({"batch_size": 1}, "batch_size must be at least 2; got 1"),
        ({"patience": 0}, "patience must be at least 1; got 0"),
        ({"seed": -1}, "seed must be at least 0; got -1"),
        ({"n_points": 0}, "n_points must be at least 1; got 0"),
        ({"learning_rate": 0.0}, r"learning_rate must be a positive number; got 0\.0"),
        ({"model": "alexnet"}, "model must be one of voxnet, pointnet, "),
        ({"seed": 2**63}, "seed must be at most 9,223,372,036,854,775,807; got 9,223,372,036,854,775,808"),
        ({"batch_size": 10**30}, "batch_size must be at most 2,147,483,647; got 1,000,"),
    ],
)
def test_a_config_says_what_is_wrong(options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        TrainConfig(**options)


def test_devices() -> None:
    assert TrainConfig(device="cpu").find_device() == torch.device("cpu")
    for name in ("tpu", "cuda:one", "cpu:"):
        with pytest.raises(OptionError, match="device must be auto, cpu, cuda or cuda:N; got"):
            TrainConfig(device=name).find_device()
    with pytest.raises(UnavailableError, match=r"device 'cuda:99' is not available: PyTorch sees \d+ CUDA devices"):
        TrainConfig(device="cuda:99").find_device()


def test_clouds_that_cannot_be_trained_on(tmp_path: Path) -> None:
    clouds = boxes(4, 0)
    with pytest.raises(ArgumentError, match="needs at least 2 clouds and validation at least 1; got 1 and 4"):
        train(CONFIG, clouds.subset([0]), clouds, tmp_path)
    alone = replace(clouds.subset([0, 2]), classes=("flat",))
    with pytest.raises(ArgumentError, match="training needs at least 2 classes; the clouds have flat"):
        train(CONFIG, alone, alone, tmp_path)
    with pytest.raises(ArgumentError, match="same classes; got flat, tall and low, high"):
        train(CONFIG, clouds, replace(clouds, classes=("low", "high")), tmp_path)
    with pytest.raises(OptionError, match="n_points must be at most 40, the points of a cloud; got 41"):
        train(replace(CONFIG, n_points=41), clouds, clouds, tmp_path)


def test_damaged_files_are_errors_in_words(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=f"must hold a trained model; it has no {MODEL}. See zbuf-occlude train"):
        load_trained(tmp_path)
    train(SHORT, *CLOUDS, tmp_path)
    whole = (tmp_path / MODEL).read_bytes()
    for damaged in (b"", b"nonsense", whole[: len(whole) // 2]):
        (tmp_path / MODEL).write_bytes(damaged)
        with pytest.raises(DatasetError, match="is damaged: it cannot be read"):
            load_trained(tmp_path)
    for another in ({"weights": {}}, {"fingerprint": ""}, [], torch.zeros(2)):
        torch.save(another, tmp_path / MODEL)
        for read in (lambda: load_trained(tmp_path), lambda: train(SHORT, *CLOUDS, tmp_path)):
            with pytest.raises(DatasetError, match="was not written by `train`"):
                read()
    (tmp_path / MODEL).unlink()
    for n_bytes in (1000, 5000):  # PyTorch fails on the second with an OSError that names no file
        (tmp_path / CHECKPOINT).write_bytes(whole[:n_bytes])
        with pytest.raises(DatasetError, match=rf"{CHECKPOINT} is damaged: it cannot be read"):
            train(SHORT, *CLOUDS, tmp_path)
    (tmp_path / CHECKPOINT).write_bytes(whole)  # a model is no checkpoint
    with pytest.raises(DatasetError, match=rf"{CHECKPOINT} does not match this version's network \(no 'optimizer'\)"):
        train(SHORT, *CLOUDS, tmp_path)
    document = torch.load(tmp_path / CHECKPOINT)
    (tmp_path / CHECKPOINT).unlink()
    for part, value, reason in (
        ("classes", ["flat"], "Error.s. in loading state_dict for VoxNet"),
        ("classes", 2, "'int' object is not iterable"),
        ("config", {**document["config"], "model": "alexnet"}, "model must be one of voxnet"),
        ("config", {**document["config"], "colour": 1}, "unexpected keyword argument 'colour'"),
        ("history", [{"loss": 1.0}], "missing 3 required"),
        ("weights", {}, "Error.s. in loading state_dict for VoxNet"),
        ("best", None, "must be a mapping"),
    ):
        torch.save({**document, part: value}, tmp_path / MODEL)
        for read in (lambda: load_trained(tmp_path), lambda: train(SHORT, *CLOUDS, tmp_path)):
            with pytest.raises(DatasetError, match=rf"{MODEL} does not match this version's network \(.*{reason}"):
                read()


def test_a_training_that_fell_apart_leaves_no_model(tmp_path: Path) -> None:
    """The only step diverges: its loss is finite, the weights after it are not."""
    with pytest.raises(OptionError, match=r"The loss is .* in epoch 1; it must stay finite\. Lower the learn"):
        train(replace(SHORT, learning_rate=1e38), *CLOUDS, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("said", [torch.OutOfMemoryError("CUDA out of memory."), RuntimeError("can't allocate memory")])
def test_want_of_memory_is_told_as_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Exception) -> None:
    def fail(*_: object) -> None:
        raise said

    monkeypatch.setattr("zbuf_occlude.studies.learn.networks.Classifier.loss", fail)
    with pytest.raises(MemoryError, match="8 clouds of 40 points a step"):
        train(CONFIG, *CLOUDS, tmp_path)
