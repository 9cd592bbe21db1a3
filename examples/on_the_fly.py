"""Occluded clouds of meshes without a dataset: python on_the_fly.py

Each time a mesh is asked for, another eye looks at it. In a DataLoader's workers the meshes stay prepared.
Needs PyTorch.
"""

import time

try:
    import torch
except ImportError:
    raise SystemExit("this example needs PyTorch: pip install 'zbuf-occlude[learn]'") from None
from torch.utils.data import DataLoader, Dataset

from zbuf_occlude.datasets.torch import OnTheFlyOcclusion
from zbuf_occlude.meshes import shapes


class Shapes(Dataset):
    """One built-in shape of each class; every epoch sees them from elsewhere."""

    def __init__(self) -> None:
        self.meshes = [shapes.make(label, 0) for label in shapes.CLASSES]
        self.occlude = OnTheFlyOcclusion(n_points=1024, elevation=(0, 50))  # degrees: from above, as people look

    def __len__(self) -> int:
        return len(self.meshes)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, int]:
        return self.occlude(self.meshes[index]), index


torch.manual_seed(0)
loader = DataLoader(Shapes(), batch_size=8)
for epoch in range(5):
    began = time.perf_counter()
    clouds, labels = next(iter(loader))
    milliseconds = 1000 * (time.perf_counter() - began) / len(clouds)
    what = "meshes are prepared" if epoch == 0 else "meshes are known"
    print(f"epoch {epoch + 1}: clouds {tuple(clouds.shape)}, {milliseconds:.1f} ms per cloud ({what})")
