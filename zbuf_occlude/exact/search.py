"""All views, shared out among threads."""

import numpy as np

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.exact.bvh import Scene
from zbuf_occlude.exact.chunks import search_chunks
from zbuf_occlude.exact.decide import hide_near_points
from zbuf_occlude.exact.layout import COORDINATE_ERROR, ENDLESS, GROUP, LEFT, RIGHT, ZERO
from zbuf_occlude.exact.points import Packets
from zbuf_occlude.exact.project import project_boxes
from zbuf_occlude.exact.view import Views, view_of
from zbuf_occlude.exact.workspace import make_workspace
from zbuf_occlude.jit.compiler import inner, merged
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.pool import n_threads, shared, take, together

PAIRS_ALONE = 10_000
"""Up to this many pairs of eye and point the calling thread answers alone: waking others takes as long."""


def find_visible(scene: Scene, points: Packets, views: Views) -> BoolArray:
    """Answer which of n points each of k eyes sees; (k, n) bool in the caller's order."""
    n_eyes, wanted = len(views.eyes), 4 * n_threads()
    n_groups = -(-len(points.chunk_reach) // GROUP)
    n_blocks = 1 if n_eyes >= wanted else min(n_groups, wanted)
    answer = np.empty((n_eyes, points.n_points), dtype=np.uint8)
    if n_blocks > 1:
        answer[:] = 1
    alone = n_eyes * points.n_points <= PAIRS_ALONE
    n_tasks = 1 if alone else n_eyes * n_blocks
    sizes = len(scene.used), scene.nodes.shape[1]
    together(_search_views, n_tasks, scene, points, views, n_blocks, answer, own=lambda: make_workspace(*sizes))
    return answer.view(bool)


@shared
def _search_views(tasks, scene, points, views, n_blocks, answer, space):
    """Take eyes, or blocks of points for an eye, and write 0 where a point is hidden."""
    _search_tasks(tasks, reference(scene), reference(points), views, n_blocks, answer, space)


@merged
def _search_tasks(tasks, scene, points, views, n_blocks, answer, space):
    n_chunks, n_groups = len(points.chunk_reach), -(-len(points.chunk_reach) // GROUP)
    task = take(tasks)
    while task < len(views.eyes) * n_blocks:
        k, block = task // n_blocks, task % n_blocks
        first = n_groups * block // n_blocks * GROUP
        last = min(n_groups * (block + 1) // n_blocks * GROUP, n_chunks)
        if n_blocks == 1:
            answer[k] = 1
        for frame in range(views.n_frames[k]):
            _search_view(scene, points, view_of(views, k, frame), (first, last), space, answer[k])
        task = take(tasks)


@merged
def _search_view(scene, points, frame, chunks, workspace, answer):
    """Answer for the chunks from one to another, in one frame of a view."""
    view, space = reference(frame), reference(workspace)
    if view.near > ZERO and view.number % 6 == 0:
        hide_near_points(scene, points, view, chunks[0], chunks[1], answer)
    project_nodes(scene, view, space)
    search_chunks(scene, points, view, chunks, space, answer)


@inner
def project_nodes(scene, view, space):
    """Fill ``space.rectangles``; those of the padding are empty."""
    project_boxes(
        scene.nodes, scene.level_starts[0], scene.nodes.shape[1], view, COORDINATE_ERROR * view.reach, space.rectangles
    )
    for level in range(len(scene.level_counts)):
        padding = scene.level_starts[level] + scene.level_counts[level]
        for i in range(padding, padding + (-padding % GROUP)):
            space.rectangles[LEFT, i], space.rectangles[RIGHT, i] = ENDLESS, -ENDLESS
