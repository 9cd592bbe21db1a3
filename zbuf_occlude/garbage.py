"""When not to look for cyclic garbage: while as many objects are made as a large collection has, all of which stay."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def nothing_to_collect() -> Iterator[None]:
    """Make objects that stay; a decorator too.

    Python looks through all that live each time a quarter has come to them. With 100,000 meshes that was half of the
    time in which a dataset's state was read, and a share that grew with them, as they no longer fit the caches.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
