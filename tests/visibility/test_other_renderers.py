"""The methods that render, on Mesa's other renderers: narrower vectors, zink over lavapipe (Vulkan), softpipe."""

import pytest

from tests.processes import run_program

SCRIPT = """
    import sys
    import numpy as np
    import zbuf_occlude as zo
    from zbuf_occlude.gl.context import GlContext
    from zbuf_occlude.errors import GlError
    from zbuf_occlude import shapes

    try:
        gl = GlContext.open("egl")
    except GlError as error:
        print(f"skip: {error}")
        raise SystemExit
    if sys.argv[1] not in gl.renderer:
        print(f"skip: the renderer is {gl.renderer}, not {sys.argv[1]}")
        raise SystemExit
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
        {"GALLIUM_DRIVER": "zink", "MESA_LOADER_DRIVER_OVERRIDE": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"},
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
    environment, renderer = RENDERERS[name]
    child = run_program(SCRIPT, renderer, **environment)
    assert child.returncode == 0, child.stderr
    if child.stdout.startswith("skip: "):
        pytest.skip(f"{name} does not open here (Debian: mesa-vulkan-drivers for zink): {child.stdout[6:].strip()}")
    assert "right on" in child.stdout
