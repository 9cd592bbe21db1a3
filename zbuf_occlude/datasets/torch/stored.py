"""A split of a dataset for PyTorch, by index or as a stream, and the paper's augmentations (4.3).

A transform takes a cloud, (n, 3 or more) float32 tensor, to another; the one given stays. Columns after the third are
what points have besides their positions, and stay too, but for normals.
"""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from zbuf_occlude.base.arrays import as_flag
from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import DatasetError, OptionError, check_choice
from zbuf_occlude.datasets.folder import read_plan
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import ATTRIBUTES, DatasetConfig
from zbuf_occlude.datasets.records import pad_or_truncate
from zbuf_occlude.datasets.source import CloudReader, open_dataset

Transform = Callable[[torch.Tensor], torch.Tensor]
Sample = tuple[torch.Tensor, torch.Tensor]

NEIGHBOURS = 64
"""Clouds of a group where files hold them in random order."""


class _Opened:
    """One split of a dataset; each process that reads it opens it."""

    def __init__(self, folder: str | os.PathLike[str], split: str) -> None:
        self.folder, self.split = as_path(folder, "folder"), split
        check_choice("split", split, self.source.order)
        self.classes, self.numbers = self.source.plan.classes, self.source.order[split]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "source"}  # opened again there

    @cached_property
    def source(self) -> CloudReader:
        """The dataset; forked processes may share it: each opens files of its own."""
        return open_dataset(self.folder)


class _Split(_Opened):
    """One split, and the points and attributes of its clouds that are taken."""

    def __init__(
        self,
        folder: str | os.PathLike[str],
        split: str,
        *,
        n_points: int | None,
        transform: Transform | None,
        attributes: Sequence[str],
    ) -> None:
        super().__init__(folder, split)
        source, self.transform = self.source, transform
        size = source.plan.config.sample_size
        if n_points is not None and not 1 <= n_points <= (size or n_points):
            most = f"lie in 1..{size}, the size of the clouds in {folder}" if size else "be at least 1"
            raise OptionError(f"n_points must {most}; got {n_points}.")
        for name in attributes:
            check_choice("attribute", name, source.plan.config.attributes)
        self.attributes = tuple(name for name in ATTRIBUTES if name in attributes)
        self.n_points = n_points or size

    def __repr__(self) -> str:
        points = "all points" if self.n_points is None else f"{self.n_points} points"
        held = f"{len(self.numbers)} clouds of {points}, {len(self.classes)} classes"
        return f"{type(self).__name__}({str(self.folder)!r}, {self.split!r}: {held})"

    def sample(self, record: Any) -> Sample:
        """Turn a record into tensors for training; the first points will do, for their order is random."""
        columns = [record["data"]]
        if "normals" in self.attributes:
            columns.append(record["normal"])
        if "colors" in self.attributes:
            columns.append(record["color"] / np.float32(255))
        table = columns[0] if len(columns) == 1 else np.concatenate(columns, axis=1)
        cloud = torch.from_numpy(np.array(table) if self.n_points is None else pad_or_truncate(table, self.n_points))
        return cloud if self.transform is None else self.transform(cloud), torch.tensor(int(record["label"][0]))


class CloudDataset(_Split, Dataset[Sample]):
    """The clouds of one split of a dataset, by index; worker-safe.

    Parameters
    ----------
    folder : path-like
        A complete dataset of any format: `hdf5`, or `packed` for a fiftieth of the disk.
    split : {"train", "val", "test"}
    n_points : int, optional
        Number of first points of each cloud, whose order is random; all by default. Clouds of fewer points repeat some.
        Without it, clouds of unequal size are items of unequal size, which `collate_ragged` puts together.
    transform : callable, optional
        Applied to each cloud, (n, 3 or more) float32 tensor to tensor: see `augmentation`.
    attributes : sequence of str
        "normals", "colors": further columns of each cloud, in this order, colours in [0, 1]; of datasets made with
        them (``generate --with``).

    Raises
    ------
    DatasetError
        There is no complete dataset in the folder.
    OptionError
        It has no such split, or `n_points` is more than its clouds have.

    Notes
    -----
    Items are (cloud, label): (n_points, 3, 6 or 9) float32 and () int64, an index into `classes`. In random order
    `packed` unpacks a block for nearly every cloud; `CloudStream` reads it many times as fast.
    """

    def __init__(  # so that the error of a mistyped argument names this class
        self,
        folder: str | os.PathLike[str],
        split: str = "train",
        *,
        n_points: int | None = None,
        transform: Transform | None = None,
        attributes: Sequence[str] = (),
    ) -> None:
        super().__init__(folder, split, n_points=n_points, transform=transform, attributes=attributes)

    def __getitem__(self, index: int) -> Sample:
        """Return (cloud, label)."""
        return self.sample(self.source.take(self.numbers[[index]])[0])

    def __getitems__(self, indices: list[int]) -> list[Sample]:
        """Return a batch; a DataLoader asks for all its clouds at once."""
        return [self.sample(record) for record in self.source.take(self.numbers[indices])]


class CloudStream(_Split, IterableDataset[Sample]):
    """The clouds of one split of a dataset as a stream, shuffled by shard; worker-safe.

    Parameters
    ----------
    folder, split, n_points, transform, attributes
        As in `CloudDataset`.
    pool : int
        Groups read at a time, whose clouds are mixed; in memory at once, 100 MB or so by default.

    Raises
    ------
    DatasetError, OptionError
        As in `CloudDataset`; `pool` is less than 1.

    Notes
    -----
    A group is a set of clouds that are read quickly together: neighbours in a file, or in `packed` the clouds of one
    sampling of one object. These are of one class; the pool mixes them. Each epoch takes the groups in another order
    and mixes the clouds of each pool. Workers share the groups, so every cloud comes once an epoch, however many they
    are.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        split: str = "train",
        *,
        n_points: int | None = None,
        transform: Transform | None = None,
        attributes: Sequence[str] = (),
        pool: int = 32,
    ) -> None:
        super().__init__(folder, split, n_points=n_points, transform=transform, attributes=attributes)
        if pool < 1:
            raise OptionError(f"pool must be at least 1; got {pool}.")
        self.pool, self._epoch = pool, 0
        blocks = self.source.blocks_of(self.numbers)
        if blocks is None:
            self.groups = np.split(self.numbers, range(NEIGHBOURS, len(self.numbers), NEIGHBOURS))
        else:
            order = np.argsort(blocks, kind="stable")
            self.groups = np.split(self.numbers[order], np.flatnonzero(np.diff(blocks[order])) + 1)

    def __iter__(self) -> Iterator[Sample]:
        worker = get_worker_info()
        # the same in all workers, and another in the next epoch: by torch's seed, or by the count where workers persist
        seed = int(torch.randint(2**62, ())) if worker is None else worker.seed - worker.id
        generator = torch.Generator().manual_seed((seed + 1_000_003 * self._epoch) % 2**63)
        self._epoch += 1
        order = torch.randperm(len(self.groups), generator=generator).tolist()
        if worker is not None:
            order = order[worker.id :: worker.num_workers]
        for start in range(0, len(order), self.pool):
            numbers = np.concatenate([self.groups[group] for group in order[start : start + self.pool]])
            records = self.source.take(numbers)
            for row in torch.randperm(len(records), generator=generator).tolist():
                yield self.sample(records[row])


class CompletionPairs(_Opened, Dataset[tuple[torch.Tensor, ...]]):
    """Partial and complete clouds of the objects of one split, in one frame, by index; worker-safe.

    Parameters
    ----------
    folder : path-like
        A complete dataset in the format `packed`, which keeps all points of its objects.
    split : {"train", "val", "test"}
    n_partial, n_complete : int
        Points of each cloud; some repeat where there are fewer.
    return_pose : bool
        Items have the pose of the camera too.

    Raises
    ------
    DatasetError
        There is no complete dataset in the folder, or it is in another format.
    OptionError
        It has no such split, or a number of points is below 1.

    Notes
    -----
    Items are (partial, complete, label): (n_partial, 3) and (n_complete, 3) float32, and () int64. The whole object is
    centred and its longest side 1; of a dataset made with ``--scale mesh`` or ``metres`` it is as in its file, of scans
    in metres. Of a dataset made with ``--frame camera`` both clouds of an item have the camera's axes. Their origin is
    then the object's centre, or the camera with ``--scale mesh`` or ``metres``.

    The pose, (4, 4) float32, takes the object's frame to the camera's, in the unit of the pair:
    ``points @ pose[:3, :3].T + pose[:3, 3]``. Its axes are OpenGL's, or by ``--axes`` OpenCV's.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        split: str = "train",
        *,
        n_partial: int = 2_048,
        n_complete: int = 8_192,
        return_pose: bool = False,
    ) -> None:
        if n_partial < 1 or n_complete < 1:
            raise OptionError(f"n_partial and n_complete must be at least 1; got {n_partial} and {n_complete}.")
        self.n_partial, self.n_complete = n_partial, n_complete
        self.return_pose = as_flag(return_pose, "return_pose")
        super().__init__(folder, split)

    def __repr__(self) -> str:
        pairs = f"{len(self)} pairs of {self.n_partial} and {self.n_complete} points, {len(self.classes)} classes"
        return f"{type(self).__name__}({str(self.folder)!r}, {self.split!r}: {pairs})"

    def __getitem__(self, index: int) -> tuple[torch.Tensor, ...]:
        """Return (partial, complete, label), or (partial, complete, label, pose)."""
        source = self.source
        record = source.take(self.numbers[[index]])[0]
        assert source.complete is not None  # packed
        complete = source.complete(record, self.n_complete)
        partial, whole = (torch.from_numpy(np.array(each["data"])) for each in (record, complete))
        pair = partial, whole, torch.tensor(int(record["label"][0]))
        return (*pair, torch.from_numpy(_pose_of_pair(record, source.plan.config))) if self.return_pose else pair

    @cached_property
    def source(self) -> CloudReader:
        """The dataset, whose partial clouds have `n_partial` points."""
        plan = read_plan(self.folder)
        if not find_format(plan.format).whole_objects:
            raise DatasetError(
                f"{self.folder} must be in the format packed, which keeps complete clouds; it is in {plan.format}. "
                "Make it with `zbuf-occlude generate --format packed`."
            )
        scale = {"cloud": "object", "metres": "mesh"}.get(plan.config.scale, plan.config.scale)
        drawn = replace(plan.config, sample_size=self.n_partial, scale=scale, attributes=())
        return open_dataset(self.folder, replace(plan, config=drawn))


def _pose_of_pair(record: Any, config: DatasetConfig) -> NDArray[np.float32]:
    """Return the matrix (4, 4) from the object's frame, scaled as a record is, to the camera's."""
    pose, centre, factor = np.array(record["pose"]), record["centre"], float(record["factor"])
    if config.frame == "camera":  # where the centre is given in the camera's frame
        pose[:3, 3] = centre if config.scale == "object" else pose[:3, 3]
    else:
        pose[:3, 3] += pose[:3, :3] @ centre
    pose[:3, 3] *= factor
    return pose.astype(np.float32)


def collate_ragged(samples: Sequence[Sample]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Put clouds of unequal size together, for ``DataLoader(dataset, batch_size=32, collate_fn=collate_ragged)``.

    Parameters
    ----------
    samples : sequence of (cloud, label)

    Returns
    -------
    points : (total, 3) float32
        Points of all clouds, one cloud after the other.
    offsets : (b + 1,) int64
        The points of cloud i are ``points[offsets[i]:offsets[i + 1]]``.
    labels : (b,) int64
    """
    clouds, labels = zip(*samples, strict=True)
    offsets = torch.tensor([0, *map(len, clouds)]).cumsum(0)
    return torch.cat(clouds), offsets, torch.stack(labels)


def _uniform(clouds: torch.Tensor) -> torch.Tensor:
    """Return a random number in [0, 1) for each cloud: () for one (n, c), (b,) for several (b, n, c); float64, CPU."""
    return torch.rand(clouds.shape[:-2]).double()


@dataclass(frozen=True)
class Rotate:
    """Turn clouds about the z axis, each by an angle uniform in [-angle, angle] (radians; all round by default).

    With `normals` columns 3 to 5 are normals, and turn along.
    """

    angle: float = math.pi
    normals: bool = False

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud (n, c), or clouds (b, n, c)."""
        turn = (2.0 * _uniform(cloud) - 1.0) * self.angle
        c, s = turn.cos(), turn.sin()
        zero, one = torch.zeros_like(c), torch.ones_like(c)
        rows = torch.stack([c, s, zero, -s, c, zero, zero, zero, one], dim=-1)
        matrix = rows.view(*turn.shape, 3, 3).to(cloud, non_blocking=True)
        n_turned = 6 if self.normals else 3
        # one product of the same shape for each: a larger product rounds differently on some processors
        turned = [cloud[..., first : first + 3].contiguous() @ matrix for first in range(0, n_turned, 3)]
        return torch.cat([*turned, cloud[..., n_turned:]], dim=-1)


@dataclass(frozen=True)
class Rescale:
    """Multiply clouds, each by a factor uniform in [low, high], PointNet++'s range by default."""

    low: float = 0.8
    high: float = 1.25

    def __post_init__(self) -> None:
        if not 0.0 < self.low <= self.high < math.inf:
            raise OptionError(f"a scale must run upwards from above 0; got {self.low}..{self.high}.")

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud (n, c), or clouds (b, n, c)."""
        factor = self.low + (self.high - self.low) * _uniform(cloud)[..., None, None]
        return torch.cat([cloud[..., :3] * factor.to(cloud, non_blocking=True), cloud[..., 3:]], dim=-1)


@dataclass(frozen=True)
class Jitter:
    """Move every coordinate by Gaussian noise, clipped; PointNet's by default, for clouds whose longest side is 1."""

    sigma: float = 0.01
    clip: float = 0.05

    def __post_init__(self) -> None:
        if self.sigma < 0.0 or self.clip < 0.0:
            raise OptionError(f"sigma and clip must not be negative; got {self.sigma} and {self.clip}.")

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud (n, c), or clouds (b, n, c)."""
        positions = cloud[..., :3]
        moved = positions + (self.sigma * torch.randn_like(positions)).clamp(-self.clip, self.clip)
        return torch.cat([moved, cloud[..., 3:]], dim=-1)


@dataclass(frozen=True)
class Compose:
    """Apply transforms one after the other."""

    transforms: Sequence[Transform]

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud."""
        for transform in self.transforms:
            cloud = transform(cloud)
        return cloud


def augmentation(*, normals: bool = False) -> Compose:
    """Return the paper's three: rotation, scaling, jitter; `normals` as in `Rotate`.

    References
    ----------
    Paper 4.3 names them without their parameters; these are those of PointNet and PointNet++ (Qi et al. 2017).
    """
    return Compose((Rotate(normals=normals), Rescale(), Jitter()))
