"""What the paper reports: Table 3A and 3B in percent, its models, elevations, test sets and footnotes."""

CITATION = (
    "V. I. Sryamkin, M. Msallam, S. A. Klestov: A method to create real-like point clouds for 3D object classification "
    "(2023), sections 4.2 to 4.4"
)

TRAIN_ELEVATIONS = (-90, -70, -50, -20, 20, 50, 70, 90)
TEST_ELEVATIONS = (-80, -60, -40, -30, -10, 0, 10, 30, 40, 60, 80)
"""Degrees (4.2): the elevations of Eq. 11 without the first eight."""

TABLE_3A: dict[str, tuple[float, ...]] = {
    "voxnet": (69.7, 71.1, 71.6, 74.4, 69.0, 50.3, 60.4, 69.3, 69.0, 68.0, 63.9),
    "pointnet": (65.6, 64.9, 74.4, 76.9, 75.5, 60.6, 75.6, 78.3, 78.2, 74.8, 68.0),
    "threedmfv": (97.6, 97.3, 98.0, 98.6, 97.6, 86.8, 97.7, 99.1, 98.5, 97.0, 97.3),
}
"""Overall accuracy by model at each of `TEST_ELEVATIONS`."""

TRAINING_SETS = {1: "generated", 2: "original", 3: "both"}
"""What the three classifiers of 4.3 are trained on."""

TABLE_3B: dict[tuple[str, int], dict[int, tuple[float, float, float, float]]] = {
    ("voxnet", 12_000): {1: (81.0, 76.3, 37.5, 66.7), 2: (82.0, 45.9, 0.0, 0.0), 3: (87.5, 79.7, 20.5, 38.1)},
    ("threedmfv", 12_000): {1: (87.0, 95.2, 77.3, 42.9), 2: (88.5, 81.3, 17.1, 19.1), 3: (89.5, 95.7, 63.6, 38.1)},
}
"""By model and points per cloud, for each training set: Test 1, Test 2, and of Test 3 the classes car and 4wd."""

TABLE_3B_FEWER: dict[tuple[str, int], dict[int, tuple[float, float]]] = {
    ("threedmfv", 1_024): {1: (88.6, 66.7), 2: (36.4, 42.9), 3: (76.1, 81.0)},
}
"""The same with fewer points, for which the paper gives Test 3 alone: car and 4wd."""

MODELNET40_ACCURACY = {"voxnet": "69.0 / 83.0", "threedmfv": "91.6"}
"""The last row of Table 3B, Test 1: training on all of ModelNet40 (VoxNet without and with rotation), by others."""

VEHICLES_F1 = ("threedmfv", 1_024, 79.3)
"""Model, points, average F1 over the six vehicle classes (4.4); of which classifier, 1, 2 or 3, is not said."""
