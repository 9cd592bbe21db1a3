"""Pairs of a partial and a complete cloud made on the fly, with the pose of the camera."""

from typing import Any

import torch

from zbuf_occlude.base.errors import ArgumentError, OptionError, check_int
from zbuf_occlude.datasets.torch.on_the_fly import OnTheFlyOcclusion, OnTheFlyScan
from zbuf_occlude.meshes.sampling import sample_surface


class OnTheFlyPairs:
    """Transform of a mesh into its partial cloud, its complete cloud and the camera's pose, another camera each time.

    Parameters
    ----------
    partial : OnTheFlyOcclusion or OnTheFlyScan
        Draws the partial clouds: its number of points, sensor, views, frame and scale. Attributes are left out.
    n_complete : int
        Points of the complete cloud, uniform over the surface and of another sample each time.

    Raises
    ------
    ArgumentError
        `partial` is neither.
    OptionError
        `n_complete` is no positive integer, or `partial` is on a device.

    Notes
    -----
    Called with a mesh, and for scans its class, as `partial` is; returns (partial, complete, pose): float32 tensors
    (n, 3), (n_complete, 3) and (4, 4), in the frames of `CompletionPairs`. With ``scale="cloud"``, the default, the
    whole object is centred and its longest side 1; with "metres" or "mesh" it keeps its size, of scans metres about the
    middle of its box. Randomness comes from torch's default generator.

    Examples
    --------
    >>> pairs = zo.torch.OnTheFlyPairs(zo.torch.OnTheFlyOcclusion(n_points=2048))
    >>> partial, complete, pose = pairs(zo.load_mesh("chair.off"))
    >>> partial.shape, complete.shape, pose.shape
    (torch.Size([2048, 3]), torch.Size([8192, 3]), torch.Size([4, 4]))
    """

    def __init__(self, partial: OnTheFlyOcclusion | OnTheFlyScan, *, n_complete: int = 8_192) -> None:
        if not isinstance(partial, OnTheFlyOcclusion | OnTheFlyScan):
            raise ArgumentError(
                f"partial must be an OnTheFlyOcclusion or an OnTheFlyScan; got {type(partial).__name__}. Make one."
            )
        check_int("n_complete", n_complete, 1)
        if isinstance(partial, OnTheFlyOcclusion) and partial.device is not None:
            raise OptionError(f"partial must have no device for pairs; got {partial.device}. Leave the device out.")
        self.partial, self.n_complete = partial, n_complete

    def __repr__(self) -> str:
        return f"OnTheFlyPairs({self.partial!r}, n_complete={self.n_complete})"

    def __call__(self, mesh: Any, label: str = "object") -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return (partial, complete, pose).

        Raises
        ------
        ArgumentError, MeshError, OptionError
            As `partial`.
        """
        cloud = self.partial.draw(mesh, label)
        seed = int(torch.randint(2**62, ()))
        complete = sample_surface(cloud.mesh, n_points=self.n_complete, seed=seed).positions
        one, whole, pose = map(torch.from_numpy, self.partial.placement.place_pair(cloud, complete))
        return one.float(), whole.float(), pose.float()
