"""`hidden_point_removal`: Katz 2007 where it is right, where it has no hull, and its radius."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import sphere, two_plates
from zbuf_occlude.base import extras
from zbuf_occlude.visibility import find_method
from zbuf_occlude.visibility.methods import oracle

EYES = zo.views.paper100(4.0).eyes[::9]

pytestmark = pytest.mark.needs("open3d")


def test_a_dense_convex_cloud_is_what_it_is_good_at() -> None:
    mesh = sphere(32)
    points = zo.sample_surface(mesh, n_points=5000, seed=0)
    truth = oracle.prepare(mesh).visible(points, EYES)
    with zo.prepare(mesh, "hidden_point_removal") as occluder:
        assert (occluder.visible(points, EYES) == truth).mean() > 0.95


def test_a_larger_radius_keeps_more() -> None:
    mesh = sphere(32)
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    kept = []
    for radius in (3.0, 100.0, 1000.0, 1e5):
        with zo.prepare(mesh, "hidden_point_removal", radius=radius) as occluder:
            kept.append(occluder.visible(points, EYES).mean())
    assert (np.diff(kept) > 0).all()


def test_by_default_the_radius_follows_the_eye() -> None:
    mesh = sphere(32)
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    with zo.prepare(mesh, "hidden_point_removal") as occluder:
        kept = [occluder.visible(points, EYES * factor).mean() for factor in (1.0, 10.0, 1000.0)]
    assert all(0.35 < k < 0.55 for k in kept)


def test_without_a_hull_in_space_all_are_taken_for_visible() -> None:
    mesh = two_plates()
    flat = zo.SurfacePoints.free(np.random.default_rng(0).random((50, 3)) * [1, 0, 1])
    with zo.prepare(mesh, "hidden_point_removal") as occluder:
        assert occluder.visible(flat.select([0]), [[0.5, 0.0, 4.0]]).all()
        assert occluder.visible(flat.select([0, 1]), [[0.5, 2.0, 4.0]]).all()
        assert occluder.visible(flat, [[0.5, 0.0, 4.0]]).all()


def test_an_eye_beyond_the_sphere_widens_it() -> None:
    mesh = sphere(16)
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    with zo.prepare(mesh, "hidden_point_removal", radius=2.0) as occluder:
        assert 0 < occluder.visible(points, [[0.0, 0.0, 1e4]]).sum() < 2000


@pytest.mark.parametrize("offset", [0.0, 1e-170])
def test_a_point_at_the_eye_is_seen_and_changes_no_other_answer(offset: float) -> None:
    mesh = sphere(16)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    with zo.prepare(mesh, "hidden_point_removal") as occluder:
        for eye in ([0.0, 0.0, 0.0], [4.0, 0.0, 0.0]):
            others = occluder.visible(points, [eye])
            positions = np.concatenate([[eye], points.positions])
            positions[0, 0] += offset
            found = occluder.visible(zo.SurfacePoints.free(positions), [eye])
            assert found[0, 0]
            assert (found[:, 1:] == others).all()
        assert occluder.visible(points.select([3]), points.positions[3:4]).all()


@pytest.mark.skipif(sys.platform != "linux", reason="only on Linux are the libraries looked for")
def test_a_missing_system_library_is_an_answer_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extras.DEBIAN, "libnowhere.so.7", "libnowhere7")
    row = replace(find_method("hidden_point_removal"), libraries=("libnowhere.so.7",))
    assert row.missing() == "needs libnowhere.so.7 for open3d; on Debian: apt-get install libnowhere7"
    with pytest.raises(zo.UnavailableError, match="method 'hidden_point_removal' needs libnowhere"):
        row.load()
