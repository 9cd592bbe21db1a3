"""The methods that render, on Mesa's other renderers: narrower vectors, zink over lavapipe (Vulkan), softpipe."""

import pytest

from tests.needs import ENVIRONMENTS, need
from tests.processes import run_program

SCRIPT = """
    import sys
    import numpy as np
    import zbuf_occlude as zo
    from zbuf_occlude.engines.gl.context import GlContext
    from zbuf_occlude.meshes import shapes

    gl = GlContext.open("egl")
    assert sys.argv[1] in gl.renderer, gl.renderer
    mesh = shapes.make("lamp", 2).normalized()
    points = zo.sample_surface(mesh, n_points=400, seed=1)
    eyes = np.concatenate([zo.views.fibonacci(2).eyes, [mesh.centre + 0.01]])  # from outside and from within
    with zo.prepare(mesh, "oracle") as oracle:
        truth = oracle.visible(points, eyes)
    for name, most in (("exact_gl", 0.0), ("depth_buffer", 0.03)):
        with zo.prepare(mesh, name, gl=gl) as occluder:
            wrong = (occluder.visible(points, eyes) != truth).mean()
        assert wrong <= most, f"{name}: {wrong} wrong"
    gl.close()
    print("right on", gl.renderer)
"""

RENDERERS = {
    "llvmpipe, 128 bits": ({"LP_NATIVE_VECTOR_WIDTH": "128"}, "128 bits"),
    "zink": (
        ENVIRONMENTS["zink"],
        "zink",
    ),
    "softpipe": (
        # it promises OpenGL 3.3 and can all that is needed
        {"GALLIUM_DRIVER": "softpipe", "MESA_GL_VERSION_OVERRIDE": "4.5", "MESA_GLSL_VERSION_OVERRIDE": "450"},
        "softpipe",
    ),
}


@pytest.mark.parametrize("name", RENDERERS)  # by EGL, whichever backend the marker `gl` is run with
def test_it_is_right_there_too(name: str) -> None:
    need("zink" if name == "zink" else "egl")
    environment, renderer = RENDERERS[name]
    child = run_program(SCRIPT, renderer, **environment)
    assert child.returncode == 0, child.stderr
    assert "right on" in child.stdout
