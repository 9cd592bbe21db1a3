"""What mkdocs does besides turning pages: it makes the gallery of docs/gallery.md"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

GENERATE = ("generate", "--limit", "24", "--views", "ring:3@25", "--method", "exact", "--sample-size", "1024")
FOLDER = "gallery-3d"


def on_post_build(config: Any) -> None:
    """Write gallery-3d/gallery.html into the site."""
    target = Path(config["site_dir"]) / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / FOLDER  # its name is the page's title
        command = [sys.executable, "-m", "zbuf_occlude"]
        subprocess.run([*command, *GENERATE, "--out", str(folder)], check=True, capture_output=True)
        subprocess.run([*command, "show", str(folder)], check=True, capture_output=True)
        shutil.copy(folder / "gallery.html", target)
