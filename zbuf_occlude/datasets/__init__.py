"""Datasets of occluded clouds: plan, shards, files, manifest; sees methods only through the table."""
