"""Objects of real drives: crops of labelled LiDAR sweeps as clouds, from folders in KITTI's or Argoverse 2's layout."""

from zbuf_occlude.learn.drives.crops import CAR, OTHER, check_drive, layout_of, read_clouds

__all__ = ["CAR", "OTHER", "check_drive", "layout_of", "read_clouds"]
