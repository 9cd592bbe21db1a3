"""Engines that make a plan's shards: worker processes on this machine, and schedulers' clusters."""
