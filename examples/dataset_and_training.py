"""A dataset on disk, then PyTorch: python dataset_and_training.py [ModelNet40 | options of generate]

The dataset is what `zbuf-occlude generate` makes; the same command again finds it done. Without a folder of meshes the
built-in shapes are used, some of them, so that it takes a minute; the training loop is a plain one. Needs PyTorch.
"""

import subprocess
import sys

try:
    import torch
except ImportError:
    raise SystemExit("this example needs PyTorch: pip install 'zbuf-occlude[learn]'") from None
from torch.utils.data import DataLoader

from zbuf_occlude.datasets.torch import CloudDataset, augmentation

meshes = sys.argv[1:] or ["--limit", "200"]
generate = [sys.executable, "-m", "zbuf_occlude", "generate", *meshes, "--views", "ring:6@20", "--method", "exact"]
subprocess.run([*generate, "--sample-size", "256", "--out", "occluded"], check=True)

train = CloudDataset("occluded", "train", n_points=256, transform=augmentation())
test = CloudDataset("occluded", "test", n_points=256)


class SmallPointNet(torch.nn.Module):
    """A function of each point, the maximum over the points, a function of that."""

    def __init__(self, n_classes: int) -> None:
        super().__init__()
        self.point = torch.nn.Sequential(torch.nn.Linear(3, 64), torch.nn.ReLU(), torch.nn.Linear(64, 128))
        self.cloud = torch.nn.Sequential(torch.nn.ReLU(), torch.nn.Linear(128, n_classes))

    def forward(self, clouds: torch.Tensor) -> torch.Tensor:
        return self.cloud(self.point(clouds).max(dim=1).values)


torch.manual_seed(0)
model = SmallPointNet(len(train.classes))
optimiser = torch.optim.Adam(model.parameters(), lr=3e-3)
for epoch in range(20):
    for clouds, labels in DataLoader(train, batch_size=16, shuffle=True):
        loss = torch.nn.functional.cross_entropy(model(clouds), labels)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        hits = [(model(clouds).argmax(dim=1) == labels).float().mean() for clouds, labels in DataLoader(test, 64)]
    if epoch % 5 == 4:
        print(f"epoch {epoch + 1}: loss {loss.item():.2f}, accuracy on the test split {torch.stack(hits).mean():.0%}")
