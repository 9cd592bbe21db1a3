"""Sizes of objects: the longest side of each class, metres, and their source."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

from zbuf_occlude.base.errors import OptionError, shown

SIZES: dict[str, float] = {
    # ModelNet40 and the built-in shapes
    "airplane": 18.0, "bathtub": 1.7, "bed": 2.1, "bench": 1.6, "bookshelf": 1.9, "bottle": 0.28, "bowl": 0.2,
    "car": 4.5, "chair": 0.95, "cone": 0.75, "cup": 0.12, "curtain": 2.4, "desk": 1.4, "door": 2.05, "dresser": 1.2,
    "flower_pot": 0.5, "glass_box": 0.4, "guitar": 1.0, "keyboard": 0.45, "lamp": 1.5, "laptop": 0.35, "mantel": 1.5,
    "monitor": 0.55, "night_stand": 0.6, "person": 1.75, "piano": 1.5, "plant": 1.0, "radio": 0.3, "range_hood": 0.9,
    "sink": 0.6, "sofa": 2.1, "stairs": 3.0, "stool": 0.65, "table": 1.5, "tent": 2.5, "toilet": 0.75,
    "tv_stand": 1.5, "vase": 0.35, "wardrobe": 2.0, "xbox": 0.3,
    # other names and classes of ShapeNetCore
    "aeroplane": 18.0, "ashcan": 0.6, "bag": 0.45, "basket": 0.4, "bicycle": 1.8, "birdhouse": 0.3, "bookcase": 1.9,
    "boat": 8.0, "bus": 12.0, "cabinet": 1.2, "camera": 0.15, "can": 0.12, "cap": 0.28, "cellular_telephone": 0.15,
    "clock": 0.35, "cell_phone": 0.15, "computer_keyboard": 0.45, "couch": 2.1, "cyclist": 1.8,
    "dishwasher": 0.85, "display": 0.55,
    "earphone": 0.2, "faucet": 0.3, "file_cabinet": 1.2, "helmet": 0.3, "jar": 0.25, "knife": 0.3,
    "loudspeaker": 0.5, "mailbox": 1.2, "microphone": 0.25, "microwave": 0.5, "motorbike": 2.1, "motorcycle": 2.1,
    "mug": 0.12, "pedestrian": 1.75, "piano_grand": 1.6, "pillow": 0.5, "pistol": 0.2, "printer": 0.5, "remote": 0.18,
    "remote_control": 0.18, "rifle": 1.0, "rocket": 20.0, "skateboard": 0.8, "speaker": 0.5, "stove": 0.9,
    "telephone": 0.2, "tower": 30.0, "train": 25.0, "trash_bin": 0.6, "truck": 8.0, "van": 5.2, "vessel": 8.0,
    "washer": 0.85, "watercraft": 8.0,
}  # fmt: skip
"""Typical longest sides of the classes, metres; assumed, as no published collection states its sizes."""

SOURCE = "assumed: typical of everyday objects of the class"
FILE = "file"
"""Name of the sizes that the files have already, in metres."""

ALL = "*"
"""Key of one size for all classes."""

MIN_SIZE, MAX_SIZE = 1e-3, 1e5
"""Accepted sizes, metres: from a grain to a mountain range."""

Sizes = Mapping[str, float] | str
"""Sizes of some classes, which take precedence over `SIZES`; or `FILE`."""


def sizes_of(value: Any) -> Sizes:
    """Return sizes from the text ``file``, ``car=4.5,chair=0.9`` or ``4.5``, from metres by class, or from one number.

    Raises
    ------
    OptionError
        `value` is none of these; a class is given twice; a size is out of range.
    """
    if isinstance(value, str) and value == FILE:
        return FILE
    pairs: list[tuple[Any, Any]]
    if isinstance(value, str):
        parts = [part.rpartition("=") for part in value.split(",")]
        pairs = [(label.strip() if equals else ALL, number) for label, equals, number in parts]
    else:
        pairs = list(value.items()) if isinstance(value, Mapping) else [(ALL, value)]
    sizes: dict[str, float] = {}
    for label, number in pairs:
        try:
            is_number = isinstance(value, str) or (isinstance(number, Real) and not isinstance(number, bool))
            size = float(number) if is_number else -1.0
        except (ValueError, OverflowError):
            size = -1.0
        if not MIN_SIZE <= size <= MAX_SIZE or not isinstance(label, str) or not label or label in sizes:
            raise OptionError(
                f"--size must be 'file', metres from {MIN_SIZE:g} to {MAX_SIZE:g}, or CLASS=metres,..., "
                f"each class once; got {shown(value)}."
            )
        sizes[label] = size
    return sizes


def size_of(label: str, sizes: Sizes, longest_side: float) -> float:
    """Return an object's longest side, metres.

    Parameters
    ----------
    label : str
        Class of the object.
    sizes : Sizes
    longest_side : float
        Longest side of the mesh, in the file's unit.

    Raises
    ------
    OptionError
        A class without a size.
    """
    if isinstance(sizes, str):
        return longest_side
    return _look_up(label, (sizes, label), (sizes, ALL), (SIZES, normalize_label(label)))


def size_beside(label: str, sizes: Sizes, longest_side: float) -> float:
    """Return the longest side, metres, of an object that stands beside a target.

    One size for all classes is meant for the target. Here it is the last resort, for a class without any other size.
    """
    if isinstance(sizes, str):
        return longest_side
    return _look_up(label, (sizes, label), (SIZES, normalize_label(label)), (sizes, ALL))


def _look_up(label: str, *candidates: tuple[Mapping[str, float], str]) -> float:
    """Return the size under the first of some keys that its table has."""
    for table, name in candidates:
        if name in table:
            return table[name]
    raise OptionError(
        f"every class must have a size in metres; {label!r} has none. Give --size {label}=METRES, or --size METRES for "
        "all, or the files' --unit, or --size file where they are in metres."
    )


def normalize_label(label: str) -> str:
    """Return a class's name in lower case, its words joined by underscores."""
    return label.strip().lower().replace(" ", "_").replace("-", "_")
