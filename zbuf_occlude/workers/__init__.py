"""Doing the jobs of a task: in this process, by a pool of processes on this machine, or by Ray; shares of SLURM."""
