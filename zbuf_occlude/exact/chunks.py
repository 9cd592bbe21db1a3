"""Chunks: the clusters before 16 neighbours are listed, chosen from for each, and its packets go through the list."""

from zbuf_occlude.exact.layout import CHUNK, COORDINATE_ERROR, GROUP, PACKET
from zbuf_occlude.exact.listing import choose, list_clusters, tighten
from zbuf_occlude.exact.project import extent_of_chunk, is_empty, joined, project_boxes, project_packet
from zbuf_occlude.exact.search_packets import search_packet, write_hidden
from zbuf_occlude.jit.compiler import merged

TIGHT_CLUSTERS = 1024
"""Lists of at most this many clusters get the rectangles of the projected faces."""


@merged
def search_chunks(scene, points, view, chunks, space, answer):
    """Answer for the chunks from one to another; writes 0 where a point is hidden."""
    rectangles = space.chunk_rectangles
    error = COORDINATE_ERROR * max(points.farthest, view.reach)
    for first in range(chunks[0], chunks[1], GROUP):
        last = min(first + GROUP, chunks[1])
        project_boxes(points.chunk_boxes, first, first + GROUP, view, error, rectangles)
        extent = extent_of_chunk(scene, points, first, view, rectangles)
        for chunk in range(first + 1, last):
            extent = joined(extent, extent_of_chunk(scene, points, chunk, view, rectangles))
        if is_empty(extent):
            continue
        n_before = list_clusters(scene, extent, space)
        if n_before <= TIGHT_CLUSTERS:
            tighten(scene, n_before, view, space)
        for chunk in range(first, last):
            extent = extent_of_chunk(scene, points, chunk, view, rectangles)
            n_listed = choose(n_before, extent, space)
            if n_listed > 0 and not is_empty(extent):
                _search_packets(scene, points, view, chunk, n_listed, space, answer)


@merged
def _search_packets(scene, points, view, chunk, n, space, answer):
    """Take the packets of a chunk through the n listed clusters."""
    for packet in range(chunk * CHUNK, (chunk + 1) * CHUNK):
        if packet * PACKET >= points.n_points:
            return
        extent, undecided = project_packet(scene, points, packet, view, space.image)
        if undecided:
            hidden = search_packet(scene, points, view, undecided, extent, n, space)
            write_hidden(points, packet * PACKET, hidden, answer)
