"""Who does the jobs of a task: this process, a pool of processes on this machine, or Ray; and shares of SLURM arrays."""
