"""Damaged files are told in words: the one place that knows what the readers of all formats raise."""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tarfile import TarError
from tokenize import TokenError
from zipfile import BadZipFile

from zbuf_occlude.errors import DatasetError

REMEDY = "Copy it again from where it was made, or make the dataset again, with --overwrite."
DAMAGES = (
    ArithmeticError,
    AttributeError,  # of HDF5, where a group stands for a dataset
    BadZipFile,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,  # of HDF5, and of ZIP members that claim to be encrypted or packed in another way
    SyntaxError,  # of NumPy, whose headers are Python
    TarError,
    TokenError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)
"""What h5py, NumPy, tarfile, zipfile and json raise, and what is done with their values, of bytes changed by chance."""


@contextmanager
def reading(path: Path, remedy: str = REMEDY) -> Iterator[None]:
    """Say of a file or folder that cannot be read, or whose content is not what was written, which it is.

    Parameters
    ----------
    path : Path
        What is read in the block.
    remedy : str
        What to do.

    Raises
    ------
    DatasetError
        In place of whatever its reader raised.
    """
    try:
        yield
    except DatasetError:  # it was said already
        raise
    except FileNotFoundError:
        raise DatasetError(f"{path} must be there; it is missing. {remedy}") from None
    except DAMAGES as error:
        text = " ".join(str(error).split())[:200]
        reason = f"no {text}" if isinstance(error, KeyError) else text or type(error).__name__
        raise DatasetError(f"{path} must be as it was written; it cannot be read ({reason}). {remedy}") from None
