"""Real scans of LiDARs: readers of labelled sweeps in published layouts, and crops of their objects."""
