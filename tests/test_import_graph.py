"""The house's floors: who may import whom, which room owns which package, and where printing is allowed."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[1] / "zbuf_occlude"
FACE = "zbuf_occlude"

FLOORS: tuple[dict[str, set[str]], ...] = (
    # from the ground up; a room may import itself, every lower floor, and what its row names besides
    {"errors": set(), "interrupts": set(), "jit": set()},
    {
        "arrays": set(),
        "checks": set(),
        "extras": set(),
        "limits": set(),
        "origin": set(),
        "seeds": set(),
        "shelf": set(),
        "versions": set(),
    },
    {"documents": set()},
    {"geometry": set()},
    {"views": set(), "meshes": set()},
    {"shapes": set()},
    {"gl": set(), "object_space": set(), "exact": set()},  # engines; none knows another
    {"visibility": set()},
    {"scenes": set()},
    {"sensors": set()},
    {FACE: set(), "drawing": set(), "workers": set()},
    {"dataset": set(), "compare": {"dataset"}},
    {"learn": set()},
    {"paper": set()},
    {"cli": set()},
    {"__main__": set()},
)

FORBIDDEN = {
    # below it, and yet not for it: the paper's own formulas are the independent check of the definition
    "object_space": {"geometry.predicates"},
}

WARMED_UP = "workers.warm"
"""What worker processes are forked from: it imports what jobs need, whatever room that is in."""

METHOD_HELPERS = {"visibility.interface", "visibility.depth_test"}
"""What a method may import of its own room. Methods do not import each other."""

SEEN_BY_USERS = {"visibility", "visibility.interface", "visibility.oracle"}
"""What of visibility/ the floors above may import: the table, the interface, and the judge with its constants."""

OWNERS: dict[str, tuple[str, ...]] = {
    # a package of the outside world and the only rooms or modules that may know it
    "moderngl": ("gl",),
    "glcontext": ("gl",),
    "OpenGL": ("visibility.pyrender_worker",),
    "pyrender": ("visibility.pyrender_worker",),
    "embreex": ("visibility.embree",),
    "open3d": ("visibility.hidden_point_removal",),
    "trimesh": ("meshes",),
    "mapbox_earcut": ("meshes",),
    "h5py": ("dataset", "learn"),
    "webdataset": ("dataset",),
    "pyarrow": ("dataset", "paper"),
    "fpsample": ("dataset",),
    "DracoPy": ("meshes",),
    "torch": ("learn", "paper", "dataset.torch"),
    "ray": ("workers",),
    "PIL": ("meshes", "dataset", "cli", "compare"),
    "matplotlib": ("drawing", "compare", "learn", "paper", "cli"),
    "click": ("cli", "__main__"),
    "tqdm": ("cli",),
}

NOT_SPOKEN = {"print", "exit", "quit", "input", "breakpoint"}
"""Built-ins that only cli/ and __main__ may call; sys.exit likewise."""


class Module(NamedTuple):
    """A module's name without the package's, and its source."""

    name: str
    source: str

    @property
    def tree(self) -> ast.Module:
        """What the source says."""
        return parsed(self.source)


@cache
def parsed(source: str) -> ast.Module:
    return ast.parse(source)


def modules() -> list[Module]:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts[-1] == "__init__":
            parts = parts[:-1]
        found.append(Module(".".join(parts) or FACE, path.read_text(encoding="utf-8")))
    return found


MODULES = modules()
NAMES = {module.name for module in MODULES}


def room_of(name: str) -> str:
    """The first part of a module's name; the package's own __init__ is the room called like it."""
    return name.partition(".")[0]


def floor_of(room: str) -> int:
    for height, floor in enumerate(FLOORS):
        if room in floor:
            return height
    raise AssertionError(f"{room} has no floor: give it one in FLOORS, and a line in docs/architecture.md")


def imports(module: Module) -> Iterator[str]:
    """Everything a module imports, late imports too, by full name; a module out of a package counts as itself."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module.name} must import by full names; line {node.lineno} is relative"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole.removeprefix(FACE + ".") in NAMES else str(node.module)


def violations(module: Module) -> Iterator[str]:
    """Say in words which rules a module breaks."""
    room = room_of(module.name)
    for full in imports(module):
        package = full.partition(".")[0]
        if package != FACE:
            owners = OWNERS.get(package)
            if owners and not any(module.name == o or module.name.startswith(o + ".") for o in owners):
                yield f"{module.name} imports {package}, which belongs to {', '.join(owners)}"
            continue
        target = full.removeprefix(FACE + ".")
        other = room_of(target)
        if other != room and module.name != WARMED_UP:
            height = floor_of(room)
            allowed = floor_of(other) < height or other in FLOORS[height][room]
            if not allowed or target in FORBIDDEN.get(room, ()):
                yield f"{module.name} imports {target}, which is not below it or not for it"
            if (other == "paper" and room != "cli") or (other == "learn" and room not in ("cli", "paper")):
                yield f"{module.name} imports {target}; only cli may"
            if other == "visibility" and target not in SEEN_BY_USERS:
                yield f"{module.name} imports {target} past the table of methods"
        elif room == "visibility" and target not in METHOD_HELPERS | {module.name}:
            yield f"{module.name} imports {target}; methods do not import each other"
        elif room == "visibility" and module.name in METHOD_HELPERS and target in METHOD_HELPERS - {module.name}:
            yield f"{module.name} imports {target}; helpers of methods stand alone"
    if room not in ("cli", "__main__"):
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in NOT_SPOKEN | {"sys.exit"}:
                yield f"{module.name} calls {ast.unparse(node.func)} in line {node.lineno}; only cli may"


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_floors(module: Module) -> None:
    assert list(violations(module)) == []


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_a_module_says_what_it_is_and_is_not_long(module: Module) -> None:
    documentation = ast.get_docstring(module.tree)
    assert documentation, "the first line of a file is a docstring that says what it is"
    assert isinstance(module.tree.body[0], ast.Expr)
    assert module.tree.body[0].lineno == 1
    n_lines = module.source.count("\n")
    assert n_lines <= 800


def test_every_room_of_the_table_exists() -> None:
    """A row for a room that is gone would guard nothing."""
    rooms = {room for floor in FLOORS for room in floor}
    assert rooms <= {room_of(name) for name in NAMES}


@pytest.mark.parametrize(
    ("name", "source", "complaint"),
    [
        ("arrays", "from zbuf_occlude.geometry.mesh import Mesh", "arrays imports geometry.mesh, which is not"),
        ("geometry.mesh", "from zbuf_occlude import views", "geometry.mesh imports views, which is not below it"),
        ("jit.vec3", "def f():\n    import zbuf_occlude.geometry.sampling", "jit.vec3 imports geometry.sampling"),
        ("gl.context", "from zbuf_occlude.object_space.planes import x", "imports object_space.planes, which is not"),
        (
            "object_space.planes",
            "from zbuf_occlude.geometry.predicates import blocks",
            "imports geometry.predicates, which is not below it or not for it",
        ),
        ("visibility.exact", "from zbuf_occlude.visibility.oracle import prepare", "methods do not import each other"),
        ("visibility.embree", "from zbuf_occlude.visibility import METHODS", "methods do not import each other"),
        ("visibility.interface", "from zbuf_occlude.visibility import depth_test", "helpers of methods stand alone"),
        ("visibility", "from zbuf_occlude.visibility.exact import prepare", "methods do not import each other"),
        ("dataset.pipeline", "from zbuf_occlude.visibility.exact import prepare", "past the table of methods"),
        ("compare.run", "from zbuf_occlude.visibility import exact", "past the table of methods"),
        ("dataset.plan", "import zbuf_occlude.cli.generate", "imports cli.generate, which is not below it"),
        ("workers.task", "from zbuf_occlude.dataset.plan import Plan", "imports dataset.plan, which is not below it"),
        ("compare.run", "from zbuf_occlude.learn import train", "imports learn.train, which is not below it"),
        ("__main__", "from zbuf_occlude.learn import train", "only cli may"),
        ("__main__", "from zbuf_occlude.paper import study", "only cli may"),
        ("visibility.exact_gl", "import moderngl", "imports moderngl, which belongs to gl"),
        ("visibility.pyrender", "from pyrender import Scene", "pyrender, which belongs to visibility.pyrender_worker"),
        ("dataset.plan", "def f():\n    import torch.nn", "torch, which belongs to learn, paper, dataset.torch"),
        ("arrays", "print(1)", "arrays calls print in line 1; only cli may"),
        ("workers.local", "import sys\nsys.exit(1)", "workers.local calls sys.exit in line 2; only cli may"),
    ],
)
def test_the_rules_can_fail(name: str, source: str, complaint: str) -> None:
    found = list(violations(Module(name, source)))
    assert any(complaint in line for line in found), found


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("visibility.exact", "from zbuf_occlude.visibility.interface import Occluder"),
        ("compare.reference_answers", "from zbuf_occlude.visibility.oracle import prepare"),
        ("workers.warm", "from zbuf_occlude.dataset.plan import Plan"),
        ("dataset.generate", "from zbuf_occlude.workers.task import Run"),
        ("cli.train", "from zbuf_occlude.learn import train\nprint(1)"),
        ("gl.context", "import moderngl, numpy"),
    ],
)
def test_the_rules_allow_what_is_right(name: str, source: str) -> None:
    assert list(violations(Module(name, source))) == []
