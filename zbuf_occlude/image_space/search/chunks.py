"""Chunks: the clusters before a few neighbours are listed, narrowed for each, and its packets go through the list."""

from numba import njit

from zbuf_occlude.image_space.layout import CHUNK, CHUNK_POINTS, COORDINATE_ERROR, GROUP, PACKET
from zbuf_occlude.image_space.search.hide import classify
from zbuf_occlude.image_space.search.listing import choose, list_clusters, tighten
from zbuf_occlude.image_space.search.packets import search_packet, write_hidden
from zbuf_occlude.image_space.search.project import extent_of_chunk, is_empty, joined, project_boxes, project_packet
from zbuf_occlude.image_space.search.setup import slot_of
from zbuf_occlude.image_space.search.workspace import put

SHARED_CHUNKS = 4
"""Chunks that share a list of clusters."""

TIGHT_CLUSTERS = 256
"""Lists of at most this many clusters get the rectangles of the projected faces."""

NARROW_CLUSTERS = 96
"""Lists of at most this many clusters are narrowed for a chunk before its packets go through them."""

ALL_HIDDEN = -1
"""Length of a chunk's list when one face hides the whole chunk."""


@njit(_nrt=False)
def search_chunks(scene, points, view, chunks, space, answer):
    """Answer for the chunks from one to another; writes False where a point is hidden."""
    rectangles = space.chunk_rectangles
    error = COORDINATE_ERROR * max(points.farthest, view.reach)
    for group in range(chunks[0], chunks[1], GROUP):
        project_boxes(points.chunk_boxes, group, group + GROUP, view, error, rectangles)
        for first in range(group, min(group + GROUP, chunks[1]), SHARED_CHUNKS):
            last = min(first + SHARED_CHUNKS, chunks[1])
            extent = extent_of_chunk(scene, points, first, view, rectangles, first - group)
            for chunk in range(first + 1, last):
                extent = joined(extent, extent_of_chunk(scene, points, chunk, view, rectangles, chunk - group))
            if is_empty(extent):
                continue
            n_before = list_clusters(scene, extent, space)
            if n_before <= TIGHT_CLUSTERS:
                tighten(scene, n_before, view, space)
            for chunk in range(first, last):
                extent = extent_of_chunk(scene, points, chunk, view, rectangles, chunk - group)
                if is_empty(extent):
                    continue
                n_listed = choose(n_before, extent, space)
                if n_listed <= NARROW_CLUSTERS:
                    n_listed = _narrow(scene, points, view, chunk, extent, n_listed, space)
                if n_listed != 0:
                    _search_packets(scene, points, view, chunk, n_listed, space, answer)


@njit(_nrt=False)
def _narrow(scene, points, view, chunk, extent, n, space):
    """Drop the clusters none of whose faces can hide anything of a chunk from the n listed; return how many stay."""
    n_left = 0
    own = (points.own[chunk * CHUNK_POINTS], points.own[(chunk + 1) * CHUNK_POINTS - 1])
    for j in range(n):
        cluster = space.listed.clusters[j]
        slot = slot_of(scene, cluster, view, space)
        maybe, covers = classify(scene, space, slot, cluster, own, points.chunk_boxes, chunk, extent)
        if covers:
            return ALL_HIDDEN
        if maybe:
            put(space.listed, n_left, cluster, space.slot_rectangles, slot)
            n_left += 1
    return n_left


@njit(_nrt=False)
def _search_packets(scene, points, view, chunk, n, space, answer):
    """Take the packets of a chunk through the n listed clusters."""
    for packet in range(chunk * CHUNK, (chunk + 1) * CHUNK):
        if packet * PACKET >= points.n_points:
            return
        extent, undecided = project_packet(scene, points, packet, view, space.image)
        if not undecided:
            continue
        hidden = undecided
        if n != ALL_HIDDEN:
            hidden = search_packet(scene, points, view, packet, undecided, extent, n, space)
        write_hidden(points, packet * PACKET, hidden, answer)
