"""A lint of the public face: names, docstrings, annotations, keyword-only options, the table of methods, its page."""

import ast
import inspect
import re
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import zbuf_occlude as zo
from tests.needs import need
from zbuf_occlude.visibility.interface import Method

ROOT = Path(__file__).parents[1]
METHODS_PAGE = ROOT / "docs" / "methods.md"

PROMISED = {
    # method: exact, needs GL, extra
    "depth_buffer": (False, True, ""),
    "exact": (True, False, ""),
    "exact_gl": (True, True, ""),
    "oracle": (True, False, ""),
    "embree": (False, False, "embree"),
    "warp": (True, False, "warp"),
    "pyrender": (False, False, "pyrender"),
    "vertex_hsr": (False, False, ""),
    "vertex_hsr_culled": (False, False, ""),
    "exact_hsr": (False, False, ""),
    "occupancy_grid": (False, False, ""),
    "hidden_point_removal": (False, False, "open3d"),
}

BETTER_NAMES = {
    # what docs/conventions.md calls things; one word per thing
    "pts": "points",
    "verts": "vertices",
    "tris": "faces",
    "num_points": "n_points",
    "npoints": "n_points",
    "point_count": "n_points",
    "num_views": "n_views",
    "cam": "eye",
    "cameras": "eyes",
    "camera_positions": "eyes",
    "viewpoints": "eyes",
    "tol": "tolerance",
    "eps": "tolerance",
    "epsilon": "tolerance",
    "idx": "ids",
    "indexes": "ids",
    "face_idx": "face_ids",
    "face_indices": "face_ids",
    "znear": "near",
    "zfar": "far",
}


class Function(NamedTuple):
    """A public function or method of the package's source, unimported."""

    where: str
    node: ast.FunctionDef
    class_docstring: str


@cache
def functions() -> list[Function]:
    found: list[Function] = []

    def collect(body: list[ast.stmt], where: str, class_docstring: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                collect(node.body, f"{where}.{node.name}", ast.get_docstring(node) or "")
            elif isinstance(node, ast.FunctionDef) and (node.name == "__init__" or not node.name.startswith("_")):
                found.append(Function(f"{where}.{node.name}", node, class_docstring))

    for path in sorted((ROOT / "zbuf_occlude").rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        collect(ast.parse(path.read_text(encoding="utf-8")).body, name, "")
    return found


def parameters(node: ast.FunctionDef) -> list[ast.arg]:
    a = node.args
    given = [*a.posonlyargs, *a.args, *([a.vararg] if a.vararg else []), *a.kwonlyargs, *([a.kwarg] if a.kwarg else [])]
    return [arg for arg in given if arg.arg not in ("self", "cls")]


def documented(docstring: str, section: str = "Parameters") -> list[str] | None:
    """Names that a NumPy section explains; None without the section."""
    lines = inspect.cleandoc(docstring).splitlines()
    try:
        start = next(i for i, line in enumerate(lines[:-1]) if line == section and set(lines[i + 1]) == {"-"}) + 2
    except StopIteration:
        return None
    names: list[str] = []
    for i, line in enumerate(lines[start:], start):
        if i + 1 < len(lines) and line and set(lines[i + 1]) == {"-"}:
            break
        if line and not line.startswith(" "):
            names += [name.strip().lstrip("*") for name in re.split(r"\s*:", line)[0].split(",")]
    return names


def is_kernel(node: ast.FunctionDef) -> bool:
    return any(
        name in ast.unparse(d)
        for d in node.decorator_list
        for name in ("njit", "intrinsic", "device_function", "always_inline", "inline_ir", "parallel_kernel")
    )


def complaints(function: Function) -> Iterator[str]:
    """Say what a public function lacks; a kernel's types are numba's."""
    node, where = function.node, function.where
    docstring = ast.get_docstring(node) or (function.class_docstring if node.name == "__init__" else "")
    if not docstring and node.name != "__init__":
        yield f"{where} must have a docstring"
    for argument in parameters(node):
        if argument.annotation is None and not is_kernel(node):
            yield f"{where} must annotate {argument.arg}"
        if argument.arg in BETTER_NAMES:
            yield f"{where} must call {argument.arg} {BETTER_NAMES[argument.arg]}"
    if node.returns is None and not is_kernel(node):
        yield f"{where} must annotate what it returns"
    explained, taken = documented(docstring), sorted(a.arg for a in parameters(node))
    if explained is not None and sorted(explained) != taken:
        yield f"{where} must explain its parameters {taken}; it explains {sorted(explained)}"


def test_every_public_function() -> None:
    assert len(functions()) > 100
    found = [line for function in functions() for line in complaints(function)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("def f(): pass", "m.f must have a docstring"),
        ("def f(x) -> None: 'Do.'", "m.f must annotate x"),
        ("def f(x: int): 'Do.'", "m.f must annotate what it returns"),
        ("def f(pts: int) -> None: 'Do.'", "m.f must call pts points"),
        (
            "def f(x: int, y: int) -> None:\n    '''Do.\n\n    Parameters\n    ----------\n    y, z : int\n    '''",
            "m.f must explain its parameters ['x', 'y']; it explains ['y', 'z']",
        ),
    ],
)
def test_the_lint_can_fail(source: str, complaint: str) -> None:
    node = ast.parse(source).body[0]
    assert isinstance(node, ast.FunctionDef)
    assert complaint in list(complaints(Function("m.f", node, "")))


def test_all_names_exist_once_and_in_order() -> None:
    constants, classes, rest = [], [], []
    for name in zo.__all__:
        assert hasattr(zo, name), name
        (constants if name.isupper() else classes if name[0].isupper() else rest).append(name)
    assert zo.__all__ == sorted(constants) + sorted(classes) + sorted(rest)
    assert len(set(zo.__all__)) == len(zo.__all__)


def test_nothing_public_is_left_out() -> None:
    shown = {name for name, value in vars(zo).items() if not name.startswith("_") and not inspect.ismodule(value)}
    assert shown <= set(zo.__all__)


@pytest.mark.parametrize("name", [n for n in zo.__all__ if callable(getattr(zo, n))])
def test_the_faces_docstrings_open_with_one_sentence(name: str) -> None:
    docstring = inspect.getdoc(getattr(zo, name)) or ""
    first = docstring.partition("\n\n")[0]
    assert re.search(r"[.:]$", first), first


@pytest.mark.parametrize("name", [n for n in zo.__all__ if inspect.isclass(getattr(zo, n))])
def test_errors_are_also_standard_ones(name: str) -> None:
    kind = getattr(zo, name)
    if issubclass(kind, Exception) and kind is not zo.OccludeError:
        assert issubclass(kind, zo.OccludeError)
        assert issubclass(kind, (ValueError, RuntimeError))


def test_the_table_is_what_was_promised() -> None:
    table = {m.name: (m.exact, m.needs_gl, m.extra) for m in zo.METHODS}
    assert len(table) == len(zo.METHODS)
    assert table == {name: row for name, row in PROMISED.items() if name in table}


def test_extras_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for method in zo.METHODS:
        if method.extra:
            assert any(method.requires in need for need in project["optional-dependencies"][method.extra])
        elif method.requires:
            assert any(need.startswith(method.requires) for need in project["dependencies"])


methods = pytest.mark.parametrize("method", zo.METHODS, ids=lambda method: method.name)


@methods
def test_summaries_are_one_short_line(method: Method) -> None:
    assert 20 <= len(method.summary) <= 100
    assert "\n" not in method.summary
    assert not method.summary.endswith(".")


def factory(method: Method) -> Callable[..., Any]:
    need(method.requires)
    return method.load()


@methods
def test_prepare_takes_a_mesh_and_options_by_name(method: Method) -> None:
    prepare = factory(method)
    mesh, *options = inspect.signature(prepare).parameters.values()
    assert (mesh.name, mesh.annotation) == ("mesh", zo.Mesh)
    assert ("gl" in [o.name for o in options]) == method.needs_gl
    for option in options:
        assert option.kind is option.KEYWORD_ONLY
        assert option.annotation is not option.empty
        assert option.name == "gl" or option.default is not option.empty
        assert re.search(rf"\b{option.name}\b", prepare.__doc__ or ""), f"{option.name} is not in the docstring"


@methods
def test_every_option_is_on_the_methods_page(method: Method) -> None:
    factory(method)
    page = METHODS_PAGE.read_text(encoding="utf-8")
    assert f"`{method.name}`" in page
    for option in method.options():
        assert f"`{option}`" in page, f"{method.name}'s option {option} is not in docs/methods.md"
