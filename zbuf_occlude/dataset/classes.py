"""The classes of published benchmarks, in the order in which their labels count them from 0."""

MODELNET40 = (
    "airplane", "bathtub", "bed", "bench", "bookshelf", "bottle", "bowl", "car", "chair", "cone", "cup", "curtain",
    "desk", "door", "dresser", "flower_pot", "glass_box", "guitar", "keyboard", "lamp", "laptop", "mantel", "monitor",
    "night_stand", "person", "piano", "plant", "radio", "range_hood", "sink", "sofa", "stairs", "stool", "table",
    "tent", "toilet", "tv_stand", "vase", "wardrobe", "xbox",
)  # fmt: skip
"""Alphabetical; `shape_names.txt` of modelnet40_ply_hdf5_2048."""

SCANOBJECTNN = (
    "bag", "bin", "box", "cabinet", "chair", "desk", "display", "door", "shelf", "table", "bed", "pillow", "sink",
    "sofa", "toilet",
)  # fmt: skip
"""`training_data/shape_names_ext.txt` of hkust-vgd/scanobjectnn."""

MVP = (
    "airplane", "cabinet", "car", "chair", "lamp", "sofa", "table", "watercraft", "bed", "bench", "bookshelf", "bus",
    "guitar", "motorbike", "pistol", "skateboard",
)  # fmt: skip
"""`cat_name` in test.py of paul007pl/VRCNet."""

CLASSES_OF = {
    "modelnet40-c": MODELNET40,
    "modelnet-o": MODELNET40,
    "modelnet40-normal": MODELNET40,
    "scanobjectnn": SCANOBJECTNN,
    "mvp": MVP,
}
"""Formats whose labels are numbers in a published list; others number the classes at hand."""
