"""A task on its way to workers of this machine: pickled once, its arrays in memory that all of them share."""

import pickle
from multiprocessing import RawArray
from typing import Any

import numpy as np

from zbuf_occlude.workers.task import Task

_ALIGNED = 64


class Sent:
    """A task that processes may be given when they are started, however many there will be.

    Parameters
    ----------
    task : Task
    """

    def __init__(self, task: Task) -> None:
        buffers: list[pickle.PickleBuffer] = []
        self._pickled = pickle.dumps(task, protocol=5, buffer_callback=buffers.append)
        arrays = [np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers]
        self._sizes = [len(array) for array in arrays]
        self._starts = np.cumsum([0, *(-(-size // _ALIGNED) * _ALIGNED for size in self._sizes)]).tolist()
        self._shared: Any = RawArray("B", max(1, self._starts[-1]))  # zeros, and a file that nobody else sees
        bytes_of = np.frombuffer(self._shared, np.uint8)
        for array, start in zip(arrays, self._starts, strict=False):
            bytes_of[start : start + len(array)] = array

    def unpacked(self) -> Task:
        """Return the task, its arrays where all have them, and not to be written to."""
        bytes_of = np.frombuffer(self._shared, np.uint8)
        bytes_of.flags.writeable = False
        pieces = [bytes_of[start : start + size] for start, size in zip(self._starts, self._sizes, strict=False)]
        task: Task = pickle.loads(self._pickled, buffers=pieces)
        return task
