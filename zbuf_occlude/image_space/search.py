"""The search: what each eye sees at once or region by region, and for the points left the clusters before them."""

import numpy as np
from numba import njit, prange

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.image_space.chunks import NEAR, search_chunks
from zbuf_occlude.image_space.contours import find_contours, make_contours
from zbuf_occlude.image_space.decide import hide_near
from zbuf_occlude.image_space.frames import Frames
from zbuf_occlude.image_space.packets import CHUNK, PACKET, Packets
from zbuf_occlude.image_space.projection import COORDINATE, FAR, ONE, project_boxes
from zbuf_occlude.image_space.regions import find_regions, make_regions
from zbuf_occlude.image_space.scene import Scene
from zbuf_occlude.image_space.settle import ask_regions, find_states, leave_all, settle
from zbuf_occlude.image_space.sides import drop_turned, find_sides
from zbuf_occlude.image_space.surface import Surface
from zbuf_occlude.image_space.tiles import make_tiles, search_tiles
from zbuf_occlude.image_space.workspace import GROUP, make_workspace
from zbuf_occlude.threads import threaded

FEW_POINTS = 4
"""With fewer points left than so many times the faces, an eye outside goes by tiles."""


@threaded
def find_visible(
    scene: Scene,
    surface: Surface,
    points: Packets,
    frames: Frames,
    following: bool,
    n_blocks: int,
    n_workers: int,
    answer: BoolArray,
) -> None:
    """Answer for all points and eyes.

    Parameters
    ----------
    scene, surface, points, frames
        What `make_scene`, `make_surface`, `make_packets`, `make_frames` made.
    following : bool
        Whether regions are looked for; only where the points are on their faces.
    n_blocks : int
        Parts into which the points are cut, for few eyes and many threads.
    n_workers : int
        Threads.
    answer : (k, n) bool
        Receives the answers, True = visible; all True before if there are several blocks.
    """
    n_eyes, n_packets = len(frames.matrices), points.coordinates.shape[1] // PACKET
    n_groups = -(-n_packets // (GROUP * CHUNK))
    n_faces = len(scene.world_corners)
    few = points.n_points < FEW_POINTS * n_faces
    for worker in prange(n_workers):
        space = make_workspace(scene, n_packets)
        regions = make_regions(len(scene.used), surface.n_vertices, following)
        contours = make_contours(len(surface.edges) // 4 + 256 if following else 0)
        n_tiled = PACKET * (n_packets if few else (n_packets // 2 if following else 0))
        tiles = make_tiles(n_tiled, len(scene.used) if n_tiled else 0)
        epoch = 0
        for task in range(worker, n_eyes * n_blocks, n_workers):
            view, block = task // n_blocks, task % n_blocks
            begin, end = n_groups * block // n_blocks, n_groups * (block + 1) // n_blocks
            if n_blocks == 1:
                fill(answer, view)
            for face in range(frames.n_frames[view]):
                epoch += 1
                search_frame(
                    scene,
                    surface,
                    points,
                    frames.matrices[view, face],
                    frames.windows[view],
                    frames.eyes[view],
                    frames.world_eyes[view],
                    face if frames.n_frames[view] > 1 else -1,
                    begin * GROUP * CHUNK,
                    min(end * GROUP * CHUNK, n_packets),
                    space,
                    regions,
                    contours,
                    tiles,
                    epoch,
                    answer[view],
                )


@njit
def fill(answer, view):  # type: ignore[no-untyped-def]
    """Begin with all points visible, just before some are hidden, so that the row is at hand."""
    answer[view] = True


# _nrt=False: the kernels allocate nothing, and counting references to their arrays would cost more than the geometry


@njit(_nrt=False)
def search_frame(  # type: ignore[no-untyped-def]
    scene, surface, points, frame, window, e, world_e, face, first, last, space, regions, contours, tiles, epoch, answer
):
    """Answer for the packets first to last in one frame of an eye; writes False where a point is hidden.

    `face` is the number of the cube's face, -1 for an eye outside.
    """
    inside = face >= 0
    eye = (np.float32(e[0]), np.float32(e[1]), np.float32(e[2]))
    world_eye = (world_e[0], world_e[1], world_e[2])
    reach = ONE
    if inside:
        reach = max(ONE, np.float32(1.001 * np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])))
    project_boxes(scene.nodes, 0, scene.nodes.shape[1], frame, window, COORDINATE * reach, space.rectangles, 0)
    for level in range(len(scene.level_counts)):
        padding = scene.level_starts[level] + scene.level_counts[level]
        for i in range(padding, padding + (-padding % 16)):
            space.rectangles[0, i] = FAR
            space.rectangles[1, i] = -FAR
    n_regions = 0
    if inside:
        if face == 0:
            hide_near(scene, points, first, last, eye, NEAR, reach, world_eye, answer)
    else:
        find_sides(scene, surface, eye, regions.front, regions.back)
        if points.on_faces:
            drop_turned(scene, surface, regions.back, space.rectangles)
        if len(regions.numbers) and find_contours(surface, regions.front, regions.back, frame, contours):
            n_regions = find_regions(scene, surface, points.row_starts, space.rectangles, eye, frame, contours, regions)
            ask_regions(scene, points, n_regions, frame, window, eye, world_eye, space, regions, epoch, answer)
    if n_regions or (points.some_known and not inside):
        find_states(scene, surface, n_regions, regions)
        n_left, n_undecided = settle(points, first, last, frame, space, regions, answer)
    else:
        n_left, n_undecided = leave_all(points, first, last, space)
    if n_left == 0:
        return
    few = n_undecided < FEW_POINTS * len(scene.world_corners) and n_left * PACKET <= len(tiles.tile_ids)
    if few and not inside:
        search_tiles(scene, points, n_left, frame, window, eye, world_eye, space, tiles, epoch, answer)
        return
    search_chunks(scene, points, n_left, frame, window, eye, world_eye, reach, inside, space, epoch, answer)
