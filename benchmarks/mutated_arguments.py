"""Give odd values to the Python API and the command line: each must be understood or refused in one line.

    python benchmarks/mutated_arguments.py [--values 1000] [--random SEED] [--only scan --only "zbuf-occlude views"]

One argument of a call that is sound is replaced by a value of another kind, or an odd one of the same kind. Exit status
1 after any exception but the package's own, an error of several lines, any warning of NumPy, and any value that passes
though it is none of the argument's kind. All runs in one process, on meshes of some faces.
"""

import contextlib
import io
import math
import os
import re
import shlex
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from random import Random
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from common import run

SLOW = 10.0
"""Seconds of processor time that a call may take once all is compiled."""
CUBE = (
    "OFF\n8 6 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
    "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
)
CAMERA = "pinhole:width=8,height=6,fov=40"
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 2.5, -0.5, 1e-300, 1e155, 1e308, float("nan"), float("inf"), 2**63, 10**400),
    *("é日本🙂",),
    *("banana", "", " ", "1", "2.5", "nan", "1,2", "5..2", "no", "a\0b", "a\nb", "../x", "\ud800", "9" * 900),
    *(b"1", 1j, Decimal(2), Fraction(1, 2), Path("x"), object(), print, int, range(2), {}, {"a": 1}, {1: 2}, {1}),
    *([], (), [1], [1, 2], (1, 2), (2, 1), [1, 2, 3], [[1, 2, 3]], ["a", "b"], [None], [[1], [1, 2]], [True, False]),
    *(np.float64(2), np.int64(3), np.bool_(True), np.array(2), np.array([1.0, 2.0]), np.zeros((0, 3))),
    *(np.zeros((2, 2)), np.full(3, np.nan), np.array(["a"]), np.array([None, 1]), np.array([1e155, 0, 0])),
    *(np.zeros(3, bool), np.zeros(3, complex)),
)  # fmt: skip
ODD_TEXTS = (
    *("", " ", "0", "1", "-1", "2.5", "1e155", "1e999", "nan", "inf", "-0", "1_0", "٣", "0x10", "9" * 400, "1e-300"),
    *(
        "banana",
        "é日本🙂",
        "no",
        "true",
        "None",
        "file",
        "all",
        "1,2",
        "1,2,3",
        "1..2",
        "2..1",
        "..",
        "1..",
        "..2",
        "1..2..3",
    ),
    *("a=1", "a=1,a=2", "=1", "a=", "a=b", "self=1", "name=x", "kind=1", "kind=pinhole", "width=0", "noise=2"),
    *("noise=no", "lasers=1", "chair=1", "[1]", "{}", "()", "ring:", "ring:0", "ring:3@99", "ring:1e9", "random:x"),
    *("grid:2", "x.json", "box:", "box:shift=", "box:rotate,rotate", "surface", "pinhole:", "pinhole:width=4", "*=2"),
    *("*=", "../x", "-", "/", "a\nb", "\t", "normals,", ",", "normals,colors,x", "exact", "contact=2", "contact=no"),
    *("contact=1e-5", "n=1"),
)


class Call(NamedTuple):
    """A call that is sound, and of which kind each argument is that may be replaced."""

    name: str
    function: Callable[..., Any]
    sound: Mapping[str, Any]
    kinds: Mapping[str, str]


# ---- what values are of a kind ---------------------------------------------------------------------------------------


def is_number(value: Any) -> bool:
    """Return whether a value is one finite real number, and no boolean."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def is_count(value: Any) -> bool:
    """Return whether a value is an integer, and no boolean."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, Integral) and not isinstance(value, bool)


def numbers(value: Any, *shapes: tuple[int, ...]) -> bool:
    """Return whether a value is an array of finite real numbers; -1 in a shape is any length."""
    try:
        array = np.asarray(value)
    except ValueError:
        return False
    fits = any(len(s) == array.ndim and all(n in (-1, m) for n, m in zip(s, array.shape, strict=True)) for s in shapes)
    return fits and array.dtype.kind in "iuf" and bool(np.isfinite(array).all())


def is_pair(value: Any) -> bool:
    """Return whether a value is two numbers."""
    return (
        isinstance(value, tuple | list | range | np.ndarray) and np.shape(value) == (2,) and all(map(is_number, value))
    )


def are_words(value: Any) -> bool:
    """Return whether a value is a sequence of words."""
    return isinstance(value, Sequence | np.ndarray) and all(isinstance(each, str) for each in value)


def is_mapping(value: Any) -> bool:
    """Return whether a value is a mapping from words."""
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def are_classes(value: Any) -> bool:
    """Return whether a value is a mapping from names to labels."""
    return is_mapping(value) and all(isinstance(each, str) or are_words(each) for each in value.values())


def is_size(value: Any) -> bool:
    """Return whether a value is sizes by class, or as they are typed."""
    if isinstance(value, str):
        return is_text_size(value)
    return is_mapping(value) and all(map(is_number, value.values()))


def is_span(value: Any) -> bool:
    """Return whether a value is a number or two, or as they are typed."""
    return is_text_span(value) if isinstance(value, str) else is_number(value) or is_pair(value)


def kinds() -> dict[str, Callable[[Any], bool]]:
    """Return for each kind of argument whether a value is of it."""
    import zbuf_occlude as zo
    from zbuf_occlude.sensors import Motion

    own: dict[str, Callable[[Any], bool]] = {
        "number": is_number,
        "count": is_count,
        "flag": lambda value: isinstance(value, bool | np.bool_),
        "typed": lambda value: is_number(value) or (isinstance(value, str) and is_text_number(value)),
        "bound": lambda value: str(value) in ("inf", "1e308") or is_number(value) or is_text_number(str(value)),
        "word": lambda value: isinstance(value, str),
        "words": are_words,
        "path": lambda value: isinstance(value, str | Path),
        "vector": lambda value: numbers(value, (3,)),
        "matrix": lambda value: numbers(value, (4, 4)),
        "box": lambda value: numbers(value, (2, 3)),
        "eyes": lambda value: isinstance(value, zo.Views) or numbers(value, (3,), (-1, 3)),
        "eye": lambda value: isinstance(value, zo.Views) or numbers(value, (3,)),
        "span": is_span,
        "pair": is_pair,
        "angles": lambda value: is_number(value) or is_pair(value),
        "ground": lambda value: is_number(value) or value == "fit",
        "classes": are_classes,
        "seed": lambda value: is_count(value) or isinstance(value, np.random.SeedSequence | np.random.Generator),
        "mesh": lambda value: isinstance(value, zo.Mesh | str | Path),
        "scene": lambda value: isinstance(value, zo.Mesh | zo.Scene | str | Path),
        "sensor": lambda value: isinstance(value, zo.sensors.Sensor | str | Path),
        "views": lambda value: isinstance(value, zo.Views | str),
        "points": lambda value: isinstance(value, zo.SurfacePoints),
        "motion": lambda value: isinstance(value, Motion),
        "mapping": is_mapping,
        "size": lambda value: is_number(value) or is_size(value),
        "shares": lambda value: is_mapping(value) and all(each is None or is_number(each) for each in value.values()),
    }
    optional = {f"{name}?": lambda value, fits=fits: value is None or fits(value) for name, fits in own.items()}
    return own | optional


def is_text_number(text: str) -> bool:
    """Return whether a text is one finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def is_text_count(text: str) -> bool:
    """Return whether a text is an integer."""
    try:
        int(text)
    except ValueError:
        return False
    return True


def is_text_span(text: str) -> bool:
    """Return whether a text is A or A..B."""
    return len(ends := text.split("..")) in (1, 2) and all(map(is_text_number, ends))


def is_text_size(text: str) -> bool:
    """Return whether a text is metres, the word file, or classes with their metres, each once."""
    if text == "file" or is_text_number(text):
        return True
    pairs = [part.rpartition("=")[::2] for part in text.split(",")]
    each_once = len({name.strip() for name, _ in pairs}) == len(pairs)
    return each_once and all(name.strip() and is_text_number(number) for name, number in pairs)


def is_text_setting(text: str) -> bool:
    """Return whether a text is KEY=VALUE."""
    return bool(re.fullmatch(r"\s*[^\s=]+\s*=.*\S.*", text, re.DOTALL))


TEXT_KINDS: dict[str, Callable[[str], bool]] = {
    "number": is_text_number,
    "count": is_text_count,
    "ground": lambda text: text in ("fit", "none") or is_text_number(text),
    "span": is_text_span,
    "size": is_text_size,
    "setting": is_text_setting,
    "vector": lambda text: len(parts := text.split(",")) == 3 and all(map(is_text_number, parts)),
    "share": lambda text: bool(text.strip()) and (not (end := text.rpartition("="))[1] or is_text_number(end[2])),
    "word": lambda text: bool(text.strip()),
    "words": lambda text: bool(text.strip(" ,")),
    "sample": lambda text: text == "all" or is_text_count(text),
}


# ---- calls -----------------------------------------------------------------------------------------------------------


def calls_of_python(folder: Path) -> list[Call]:
    """Return the calls of the API."""
    import zbuf_occlude as zo
    from zbuf_occlude.sensors import Motion, look_at, make
    from zbuf_occlude.sensors.scenes import Placed
    from zbuf_occlude.views import for_mesh, from_angles, parse

    path = folder / "cube.off"
    cube = zo.load_mesh(path)
    scene, views = zo.Scene.joined([Placed(cube, "crate")]), zo.views.for_mesh(cube, "ring:2@30")
    points, eye = zo.sample_surface(cube, n_points=20), [3.0, 2.0, 1.5]
    occluder = zo.prepare(cube, "oracle")
    camera = {"azimuth": "number?", "elevation": "number?", "distance": "number"}
    at = {"azimuth": 30, "elevation": 20}
    sensor, pose = make(CAMERA), look_at(eye, [0.5, 0.5, 0.5])

    def listed(*arguments: Any, **options: Any) -> list[Any]:
        return list(zo.frames(*arguments, **options))

    def bop(**options: Any) -> list[str]:
        with tempfile.TemporaryDirectory() as place:
            return zo.write_bop(place, **options)

    def made(name: Any, **numbers: Any) -> Any:
        return make(name, **numbers)

    def written(**options: Any) -> list[str]:
        with tempfile.TemporaryDirectory() as place:
            return zo.write_frames(place, listed(cube, views, width=8, height=6), **options)

    def placed(folder: Any) -> list[str]:
        shutil.rmtree("frames", ignore_errors=True)
        return zo.write_frames(folder, listed(cube, views, width=8, height=6))

    picture = {"width": "count?", "height": "count?", "fov": "number?", "method": "word"}
    small = {"width": 8, "height": 6}
    calls = [
        Call("occlude", zo.occlude, {"mesh": cube, **at, "n_points": 20},
             {"mesh": "mesh", **camera, "n_points": "count?", "seed": "seed", "method": "word", "frame": "word",
              "sensor": "sensor?", "colors": "flag", "contact": "number"}),
        Call("occlude", zo.occlude, {"mesh": cube, "eye": eye, "density": 9.0}, {"eye": "eye", "density": "number?"}),
        Call("depth_image", zo.depth_image, {"mesh": cube, **at, "resolution": 6},
             {"mesh": "mesh", **camera, "resolution": "count", "fov": "number?", "method": "word"}),
        Call("scan", zo.scan, {"scene": cube, "sensor": CAMERA, "range": 5},
             {"scene": "scene", "sensor": "sensor", "range": "number?", "azimuth": "number?", "elevation": "number?",
              "size": "number?", "transparent": "shares?", "motion": "motion?", "seed": "seed", "method": "word?",
              "towards": "box?"}),
        Call("scan", zo.scan, {"scene": scene, "sensor": sensor, "pose": pose},
             {"scene": "scene", "sensor": "sensor", "pose": "matrix?"}),
        Call("frames", listed, {"mesh": cube, "views": views, **small},
             {"mesh": "scene", "views": "views", **picture, "colors": "flag"}),
        Call("write_bop", bop, {"scenes": scene, "views": views, **small},
             {"views": "views", **picture, "split": "word", "background": "words"}),
        Call("write_frames", written, {}, {"unit": "number?"}),
        Call("write_frames", placed, {"folder": "frames"}, {"folder": "path"}),
        Call("PartialCloud.save", zo.occlude(cube, **at, n_points=20).save, {"path": "cloud.ply"}, {"path": "path"}),
        Call("Scan.save", zo.scan(cube, sensor, pose).save, {"path": "scan.pcd"}, {"path": "path"}),
        Call("read_intrinsics", zo.sensors.read_intrinsics, {"path": "camera.json"}, {"path": "path"}),
        Call("read_trajectory", zo.sensors.read_trajectory, {"path": "drive.txt"}, {"path": "path"}),
        Call("read_rig", zo.sensors.read_rig, {"path": "rig.yaml"}, {"path": "path"}),
        Call("from_csv", zo.views.from_csv, {"path": "views.csv"}, {"path": "path", "distance": "number"}),
        Call("from_json", zo.views.from_json, {"path": "cameras.json"}, {"path": "path"}),
        Call("from_colmap", zo.views.from_colmap, {"path": "images.txt"}, {"path": "path"}),
        Call("visible_faces", zo.visible_faces, {"scene": cube, "eyes": eye, "n_points": 50},
             {"scene": "scene", "eyes": "eyes", "points_per_face": "count", "n_points": "count", "seed": "seed",
              "exactly": "flag", "method": "word", "contact": "number"}),
        Call("visible_vertices", zo.visible_vertices, {"mesh": cube, "eyes": eye}, {"mesh": "mesh", "eyes": "eyes"}),
        Call("visible_mesh", zo.visible_mesh, {"mesh": cube, "eyes": eye},
             {"mesh": "mesh", "eyes": "eyes", "contact": "number"}),
        Call("coverage", zo.coverage, {"scene": cube, "eyes": eye, "n_points": 20},
             {"scene": "scene", "eyes": "eyes", "n_points": "count", "seed": "seed", "greedy": "flag"}),
        Call("coverage", zo.coverage, {"scene": scene, "eyes": eye, "sensor": CAMERA, "n_points": 20},
             {"scene": "scene", "eyes": "eyes", "sensor": "sensor", "min_density": "number"}),
        Call("visibility_grid", zo.visibility_grid, {"mesh": cube, "eyes": eye, "n": 4},
             {"mesh": "mesh", "eyes": "eyes", "n": "count", "method": "word"}),
        Call("blockers", zo.blockers, {"mesh": cube, "points": points, "eye": eye},
             {"mesh": "mesh", "points": "points", "eye": "vector"}),
        Call("occlusion_graph", zo.occlusion_graph, {"scene": scene, "eye": eye, "n_points": 20},
             {"eye": "vector", "n_points": "count", "seed": "seed"}),
        Call("prepare", zo.prepare, {"mesh": cube, "method": "exact"},
             {"mesh": "mesh", "method": "word", "contact": "number"}),
        Call("prepare", zo.prepare, {"mesh": cube, "method": "hidden_point_removal"}, {"exponent": "number"}),
        Call("prepare", zo.prepare, {"mesh": cube, "method": "occupancy_grid"}, {"n": "count"}),
        Call("visible", occluder.visible, {"points": points, "eyes": eye}, {"points": "points", "eyes": "eyes"}),
        Call("first_hits", occluder.first_hits, {"origins": [eye], "directions": [[-1.0, -1, -1]]}, {}),
        Call("sample_surface", zo.sample_surface, {"mesh": cube, "n_points": 9},
             {"mesh": "mesh", "n_points": "count", "seed": "seed"}),
        Call("sample_surface", zo.sample_surface, {"mesh": cube, "density": 9.0}, {"density": "number"}),
        Call("load_mesh", zo.load_mesh, {"path": path},
             {"path": "path", "up": "word?", "name": "word?", "colors": "flag"}),
        Call("ring", zo.views.ring, {"n_views": 3, "elevation": 30},
             {"n_views": "count", "elevation": "angles", "distance": "number"}),
        Call("drive", zo.views.drive, {"n_views": 3},
             {"n_views": "count", "half_within": "number", "elevation": "pair", "distance": "number", "seed": "seed"}),
        Call("grid", zo.views.grid, {"n_elevations": 2, "n_azimuths": 2},
             {"n_elevations": "count", "n_azimuths": "count", "elevation": "pair", "azimuth": "pair?",
              "distance": "number"}),
        Call("fibonacci", zo.views.fibonacci, {"n_views": 3}, {"n_views": "count", "distance": "number"}),
        Call("random", zo.views.random, {"n_views": 3},
             {"n_views": "count", "elevation": "pair", "distance": "number", "seed": "seed"}),
        Call("from_angles", from_angles, {"azimuth": 1, "elevation": 2},
             {"azimuth": "number", "elevation": "number", "distance": "number", "roll": "number"}),
        Call("parse", parse, {"spec": "ring:3@30"}, {"spec": "word", "distance": "number", "seed": "seed",
                                                  "farthest": "number?"}),
        Call("for_mesh", for_mesh, {"mesh": cube, "spec": "ring:3@30"}, {"mesh": "mesh", "spec": "views"}),
        Call("Views", zo.Views, {"azimuth": [0.1], "elevation": [0.2], "distance": 3.0}, {"target": "vector"}),
        Call("Scene.from_mesh", zo.Scene.from_mesh, {"mesh": cube}, {"mesh": "mesh", "label": "word"}),
        Call("Placed", Placed, {"mesh": cube, "label": "crate"},
             {"mesh": "mesh", "label": "word", "albedo": "number?", "is_background": "flag"}),
        Call("make", made, {"name": CAMERA},
             {"name": "sensor", "noise": "typed", "range_max": "bound", "width": "typed", "fov": "typed?"}),
        Call("make", made, {"name": "vlp-16"}, {"columns": "typed", "noise": "typed", "sigma": "typed"}),
        Call("Motion", Motion, {}, {"velocity": "vector", "turn": "number", "deskew": "flag"}),
        Call("crop_objects", zo.crop_objects, {"source": folder / "boxes.csv", "ground": None},
             {"source": "path", "classes": "classes?", "least_points": "count", "margin": "number",
              "ground": "ground?", "range": "pair?", "frame": "word", "distinct": "number"}),
        Call("look_at", look_at, {"position": eye, "target": [0, 0, 0]},
             {"position": "vector", "target": "vector", "up": "vector?"}),
        Call("compare_scans", zo.compare_scans,
             {"mesh": cube, "scans": [zo.scan(cube, sensor, pose).points], "sensor": sensor, "sensor_pose": pose},
             {"mesh": "mesh", "sensor": "sensor", "sensor_pose": "matrix?", "tolerance": "number?", "slack": "number?",
              "depth_unit": "number?", "refine": "flag", "method": "word?", "seed": "count"}),
        Call("MeshCollection", zo.MeshCollection.from_paths, {"paths": path},
             {"paths": "path", "up": "word?", "colors": "flag"}),
        Call("Mesh.transformed", cube.transformed, {"scale": 2.0}, {"scale": "number", "translation": "vector"}),
    ]  # fmt: skip
    with contextlib.suppress(ImportError):
        from zbuf_occlude.datasets.torch.on_the_fly import OnTheFlyOcclusion, OnTheFlyScan

        calls += [
            Call("OnTheFlyScan", OnTheFlyScan, {},
                 {"n_points": "count", "sensor": "sensor", "numbers": "mapping?", "surroundings": "nothing",
                  "scale": "word", "range": "span?", "size": "size?", "scene": "word", "hidden": "span?",
                  "keep": "word", "sensor_height": "number?", "transparent": "shares", "method": "word",
                  "keep_clean": "flag"}),
            Call("OnTheFlyOcclusion", OnTheFlyOcclusion, {},
                 {"n_points": "count", "distance": "number", "elevation": "span", "method": "word?",
                  "method_options": "mapping?", "scale": "word", "eyes_per_sampling": "count", "attributes": "words",
                  "cache_megabytes": "number"}),
        ]  # fmt: skip
    return calls


def calls_of_commands() -> list[tuple[str, dict[str, str]]]:
    """Return commands that are sound, and the options that may be added, each with its kind."""
    about = {"--azimuth": "number", "--elevation": "number"}
    camera = {**about, "--distance": "number", "--roll": "number", "--fov": "number", "--seed": "count"}
    scans = {
        "--sensor": "word", "--set-sensor": "setting", "--range": "span", "--size": "size", "--scene": "word",
        "--hidden": "span", "--keep": "word", "--sensor-height": "number", "--transparent": "share",
        "--velocity": "vector", "--turn": "number",
    }  # fmt: skip
    return [
        ("visible cube.off --method oracle --points 20 --out o.ply",
         {**camera, "--points": "count", "--set": "setting", "--with": "words", "--up": "word", "--index": "count"}),
        ("depth cube.off --resolution 6 --out o.npy", {**camera, "--resolution": "count", "--up": "word"}),
        (f"scan cube.off --sensor {CAMERA} --range 5 --size 1 --method oracle --out o.ply",
         {**about, **scans, "--seed": "count", "--up": "word", "--picture": "word", "--unit": "word"}),
        ("crop boxes.csv --out o --ground none",
         {"--classes": "word", "--least-points": "count", "--margin": "number", "--ground": "ground",
          "--range": "span", "--frame": "word", "--distinct": "number"}),
        ("shapes car --out o.off", {"--number": "count", "--seed": "count", "--up": "word"}),
        (f"compare-scans cube.off scan.npy --sensor {CAMERA} --eye 3,2,1.5 --look-at .5,.5,.5 --method oracle --out o",
         {"--eye": "vector", "--look-at": "vector", "--up-axis": "vector", "--tolerance": "number",
          "--slack": "number", "--depth-unit": "number", "--seed": "count", "--set-sensor": "setting"}),
        (f"views cube.off --views ring:2@30 --coverage --points 20 --unit m --sensor {CAMERA}",
         {"--min-density": "number", "--points": "count", "--seed": "count", "--unit": "word",
          "--set-sensor": "setting", "--distance": "span"}),
        ("views cube.off --views ring:3@30", {"--views": "word", "--distance": "span", "--points": "count"}),
        ("generate cube.off --out o --overwrite --dry-run --method oracle --points 30 --sample-size 9 --views ring:1@0",
         {"--views": "word", "--distance": "span", "--points": "count", "--sample-size": "sample", "--seed": "count",
          "--variations": "count", "--limit": "count", "--with": "words", "--shard": "word", "--set": "setting",
          "--density": "number", "--mesh-seconds": "number", "--scale": "word", "--classes": "words"}),
        (f"generate cube.off --out o --overwrite --dry-run --sensor {CAMERA} --size 1 --range 5 --views ring:1@0",
         scans),
    ]  # fmt: skip


# ---- trying ----------------------------------------------------------------------------------------------------------


def traced(error: Exception) -> str:
    """Return what an exception is that nobody meant, and where it is from."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    return f"fault: {type(error).__name__}: {str(error)[:120]} ({Path(where.filename).name}:{where.lineno})"


def tried(call: Call, name: str, value: Any, fits: Callable[[Any], bool]) -> str:
    """Call with one argument replaced, and say what came of it."""
    from zbuf_occlude.base.errors import OccludeError

    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", UserWarning)
        try:
            call.function(**{**call.sound, **({name: value} if name else {})})
        except OccludeError as error:
            in_a_line = "\n" not in str(error) and len(str(error)) < 2000
            return "refused" if in_a_line else f"fault: it says {str(error)[:200]!r}"
        except Exception as error:
            return traced(error)
    return "understood" if fits(value) else "fault: it passes"


def commanded(line: str, option: str, text: str, fits: Callable[[str], bool]) -> str:
    """Run a command with an option, `option` "" for none, and say what came of it."""
    from zbuf_occlude.__main__ import main

    shutil.rmtree("o", ignore_errors=True)
    words = shlex.split(line)
    if option in words:
        words[words.index(option) + 1] = text
    elif option:
        words += [f"{option}={text}"]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(patch.object(sys, "argv", ["zbuf-occlude", *words]))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("error", RuntimeWarning)
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        try:
            main()
        except SystemExit as leaving:
            code = leaving.code or 0
        except Exception as error:
            return traced(error)
    errors = [said for said in err.getvalue().splitlines() if said.startswith("error: ")]
    if "Traceback" in err.getvalue() or (code and len(errors) != 1):
        return f"fault: exit {code}, it says {err.getvalue()[-300:]!r}"
    if code:
        return "refused"
    return "understood" if fits(text) else "fault: it passes"


def sound(attempt: Callable[[], str]) -> str:
    """Make a call that is sound; whatever comes of it but success is a fault."""
    said = attempt()
    return said if said == "understood" else f"fault: it is {said}"


def tries(values: int, random: int, only: Iterable[str], folder: Path) -> Iterable[tuple[str, Callable[[], str]]]:
    """Yield what is tried and how: all that is sound, then arguments and options in turn."""
    rng, of = Random(random), {**kinds(), "nothing": lambda value: value is None}
    wanted = tuple(only)
    calls = [call for call in calls_of_python(folder) if not wanted or call.name in wanted]
    commands = [each for each in calls_of_commands() if not wanted or f"zbuf-occlude {each[0].split()[0]}" in wanted]
    for call in calls:
        yield f"sound: {call.name}", partial(sound, partial(tried, call, "", None, lambda value: True))
    for line, _ in commands:
        yield f"sound: {line}", partial(sound, partial(commanded, line, "", "", lambda text: True))
    python = [(call, name) for call in calls for name in call.kinds]
    typed = [(line, option, kind) for line, options in commands for option, kind in options.items()]
    for number in range(values):
        if python and (number % 2 == 0 or not typed):
            call, name = python[number // 2 % len(python)]
            value = rng.choice(ODD)
            yield f"{call.name}({name}={shown(value)})", partial(tried, call, name, value, of[call.kinds[name]])
        elif typed:
            line, option, kind = typed[number // 2 % len(typed)]
            text = rng.choice(ODD_TEXTS)
            what = f"zbuf-occlude {line.split()[0]} {option}={text[:60]!r}"
            yield what, partial(commanded, line, option, text, TEXT_KINDS[kind])


def write_inputs() -> None:
    """Write a cube, a scan of it, a table with its box, cameras, a drive and a rig, into the current folder."""
    import zbuf_occlude as zo
    from zbuf_occlude.sensors import look_at

    Path("cube.off").write_text(CUBE)
    pose = look_at([3.0, 2.0, 1.5], [0.5, 0.5, 0.5])
    np.save("scan.npy", zo.scan("cube.off", CAMERA, pose).points)
    np.save("points.npy", zo.sample_surface("cube.off", n_points=100).positions)
    Path("boxes.csv").write_text("file,label,x,y,z,length,width,height\npoints.npy,Car,.5,.5,.5,2,2,2\n")
    Path("camera.json").write_text('{"fx": 9, "fy": 9, "cx": 4, "cy": 3, "width": 8, "height": 6, "depth_scale": 1}')
    Path("cameras.json").write_text('{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 5]}')
    Path("views.csv").write_text("azimuth,elevation\n30,20\n")
    Path("images.txt").write_text("1 1 0 0 0 0 0 5 1 a.png\n\n")
    Path("drive.txt").write_text("0 0 0 0 0 0 0 1\n1 15 0 0 0 0 0 1\n")
    Path("rig.yaml").write_text("sensors: [{name: top, sensor: vlp-16}]")


def shown(value: Any) -> str:
    """Return a value as a line shows it; a number of too many digits has no other form."""
    try:
        return " ".join(repr(value).split())[:60]
    except ValueError:
        return f"a {type(value).__name__}"


def main(*, values: int = 1000, random: int = 0, only: Sequence[str] = ()) -> int:
    counts: Counter[str] = Counter()
    n_faults = 0
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        os.mkdir("here")  # ../x is inside the temporary folder, too
        os.chdir("here")
        write_inputs()
        for what, attempt in tries(values, random, only, Path.cwd()):
            begun = time.process_time()
            outcome = attempt()
            if (took := time.process_time() - begun) > SLOW and not what.startswith("sound"):  # these compile
                outcome = f"fault: it took {took:.0f} s; {outcome}"
            counts[outcome.partition(":")[0]] += 1
            if outcome.startswith("fault"):
                n_faults += 1
                print(f"{what}: {outcome}", flush=True)
    print(f"seed {random}: " + ", ".join(f"{n} {what}" for what, n in sorted(counts.items())))
    return int(bool(n_faults))


if __name__ == "__main__":
    run(main, __doc__)
