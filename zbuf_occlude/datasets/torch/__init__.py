"""Training straight from a dataset, or from meshes without one (extra ``learn``): what a DataLoader takes.

    train = CloudStream("occluded", "train", n_points=1024, transform=augmentation())
    for clouds, labels in torch.utils.data.DataLoader(train, batch_size=32, num_workers=2): ...

    pairs = CompletionPairs("packed")                     # (partial, complete, label)

    occlude = OnTheFlyOcclusion(n_points=1024)
    cloud = occlude(mesh)                                 # another eye each time

    mask = visible(vertices, faces, points, face_ids, eyes)  # tensors, on their device (extra ``warp``)

    scan = OnTheFlyScan(n_points=1024, sensor="hdl-64e", scene="street")
    cloud = scan(mesh, "car")                             # another azimuth, range and street each time

    pairs = OnTheFlyPairs(occlude)                        # or OnTheFlyPairs(scan)
    partial, complete, pose = pairs(mesh)

Everything random here comes from torch's generators: `torch.manual_seed`, and in workers their own seeds, decide it.
"""

from zbuf_occlude.base.extras import importing

with importing("torch", "zbuf_occlude.datasets.torch"):
    from zbuf_occlude.datasets.torch.on_the_fly import OnTheFlyOcclusion, OnTheFlyScan
    from zbuf_occlude.datasets.torch.on_the_fly_pairs import OnTheFlyPairs
    from zbuf_occlude.datasets.torch.stored import (
        CloudDataset,
        CloudStream,
        CompletionPairs,
        Compose,
        Jitter,
        Rescale,
        Rotate,
        augmentation,
        collate_ragged,
    )
    from zbuf_occlude.datasets.torch.tensors import first_hits, visible

__all__ = [
    "CloudDataset",
    "CloudStream",
    "CompletionPairs",
    "Compose",
    "Jitter",
    "OnTheFlyOcclusion",
    "OnTheFlyPairs",
    "OnTheFlyScan",
    "Rescale",
    "Rotate",
    "augmentation",
    "collate_ragged",
    "first_hits",
    "visible",
]
