"""Built-in shapes: the paper's ModelNet8 classes as parametric families, solids, formulas, benchmark meshes.

    shapes.CLASSES                      the eight labels
    shapes.make("chair", 7)             one member of a family, a Mesh
    shapes.collection()                 all 600 as a MeshCollection, nothing built yet
    shapes.road_user("truck", (8, 2.5, 3))    people, cyclists, trucks, buses as large as a box
    shapes.traffic.collection()         cars, vans, trucks, buses, cyclists, pedestrians, of random sizes
    shapes.solids.icosphere(4)          a sphere; and a box
    shapes.formulas.make("torus")       surfaces given by formulas, such as the paper's Fig. 9
    shapes.benchmark_mesh(45_000)       a mesh of a chosen number of faces

Shapes are computed, not stored: the same arguments give the same bytes.
"""

from zbuf_occlude.meshes.shapes import formulas, solids, traffic
from zbuf_occlude.meshes.shapes.benchmark import benchmark_mesh, refined, soup, with_vertices
from zbuf_occlude.meshes.shapes.families import CLASSES, MEMBERS, collection, key_of, make, split_of
from zbuf_occlude.meshes.shapes.road_users import ROAD_USERS, road_user

__all__ = [
    "CLASSES",
    "MEMBERS",
    "ROAD_USERS",
    "benchmark_mesh",
    "collection",
    "formulas",
    "key_of",
    "make",
    "refined",
    "road_user",
    "solids",
    "soup",
    "split_of",
    "traffic",
    "with_vertices",
]
