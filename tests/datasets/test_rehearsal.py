"""What is compiled ahead, before workers start, is all that the job then calls."""

import subprocess
import sys

import pytest

from tests.processes import python

JOB = """
import gc, sys, tempfile
from contextlib import nullcontext
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from zbuf_occlude.datasets.plan import Plan, DatasetConfig
from zbuf_occlude.datasets.rehearsal import warm_up_jit
from zbuf_occlude.datasets.shard import make_shard, read_shard
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes
from zbuf_occlude.base.jit import compiler
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig

def compiled():
    functions = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {(each.py_func.__qualname__, str(types)) for each in functions for types in each.overloads}

method, scene, kind = sys.argv[1:]
boxes = ["boxes"] if kind.endswith("boxes") else []
keep = "all" if boxes else "target"
scan = ScanConfig(make("hdl-64e"), range=(10.0, 10.0), scene=scene, keep=keep) if scene else None
compiler.note_compiled = print
config = DatasetConfig(method, views="ring:2@0", scan=scan, attributes=boxes, complete=kind == "complete")
warm_up_jit(config)
ahead = compiled()
with tempfile.TemporaryDirectory() as out, GlContext.open() if method == "depth_buffer" else nullcontext() as gl:
    plan = Plan(shapes.collection().interleaved().limit(2), config)
    make_shard(plan, 0, Path(out), gl)
    report, _ = read_shard(plan, Path(out), 0)
assert not report.failures, report.failures
print(sorted(compiled() - ahead))
"""


@pytest.mark.parametrize(
    ("method", "scene", "kind"),
    [
        ("exact", "", "exact"),
        pytest.param("depth_buffer", "", "depth_buffer", marks=pytest.mark.gl),
        ("exact", "street", "exact-scans"),
        ("exact", "street", "exact-boxes"),
        ("exact", "", "complete"),
        ("exact", "street", "complete"),
    ],
)
def test_a_job_calls_no_function_that_was_not_compiled_ahead(method: str, scene: str, kind: str) -> None:
    child = subprocess.run(
        [sys.executable, "-c", JOB, method, scene, kind], capture_output=True, text=True, check=False
    )
    assert child.returncode == 0, child.stderr
    assert child.stdout.split("\n")[:2] == [kind, "[]"]


SHARED = """
from zbuf_occlude.datasets import records
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.datasets.rehearsal import warm_up_jit
from zbuf_occlude.meshes import sampling
from zbuf_occlude.visibility.methods import oracle

kernels = records._draw, records._place, oracle._look, sampling._count, sampling._place, sampling._fill_faces
for each in (records.DRAWING, oracle.ORACLE, sampling.SAMPLING):
    each.function()
ahead = [set(kernel.signatures) for kernel in kernels]
warm_up_jit(DatasetConfig("exact", views="ring:2@0"))
print(all(ahead), [set(kernel.signatures) for kernel in kernels] == ahead)
"""


def test_the_second_process_compiles_for_the_arguments_of_a_job() -> None:
    child = python("-c", SHARED)
    assert child.stdout.split() == ["True", "True"], child.stderr
