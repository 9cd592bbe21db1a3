"""First hits of rays: the mesh is drawn from each origin, and the faces in the nearest pixels are tested."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.threads import n_blocks, parallel_for, parallel_kernel, take_block
from zbuf_occlude.engines.gl.buffers import Buffers, block_limit, parts
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import MAX_TILES, DepthPass
from zbuf_occlude.engines.gl.shaders import set_uniforms
from zbuf_occlude.engines.gl.tiles import CUBE, TILE, Pictures, arrange_tiles, cube_pictures, single_pictures
from zbuf_occlude.geometry.camera import cube_faces
from zbuf_occlude.geometry.predicates import ray_triangle_t

PIXELS_PER_RAY = 16
"""Pixels whose faces are tested per ray, 4 x 4."""

BLOCK = 1024
"""Rays per block of a thread."""

_LANES = 64  # invocations of a work group


class PicturedRays(NamedTuple):
    """Rays whose origins have pictures of one kind: fitted to the mesh, or cube faces."""

    tiles_per_eye: int  # 1, or `CUBE`
    pictures: Pictures
    rays: NDArray[np.int64]  # (r,) indices of the rays, ordered by picture
    tiles: NDArray[np.int64]  # (r,) index of the picture that each ray passes through
    pixels: FloatArray  # (r, 2) position in pixels from the picture's lower left


def picture_rays(
    origins: FloatArray, directions: FloatArray, positions: FloatArray, resolution: int
) -> list[PicturedRays]:
    """Group rays by picture, all in unit space; rays that pass through no picture, and miss the mesh, are left out."""
    distinct, origin_of = np.unique(origins, axis=0, return_inverse=True)
    origin_of = origin_of.reshape(-1)
    fits, fitted = single_pictures(distinct, positions, resolution)
    groups = []
    outside = np.flatnonzero(fits[origin_of])
    if len(outside):
        groups.append(_pictured(1, fitted, outside, (np.cumsum(fits) - 1)[origin_of[outside]], directions, resolution))
    inside = np.flatnonzero(~fits[origin_of])
    if len(inside):
        sides = (np.cumsum(~fits) - 1)[origin_of[inside]] * CUBE + cube_faces(directions[inside]).astype(np.int64)
        used, tiles = np.unique(sides, return_inverse=True)
        pictures = cube_pictures(distinct[~fits], positions, resolution).select(used)
        groups.append(_pictured(CUBE, pictures, inside, tiles.reshape(-1), directions, resolution))
    return groups


def _pictured(
    tiles_per_eye: int,
    pictures: Pictures,
    rays: NDArray[np.int64],
    tiles: NDArray[np.int64],
    directions: FloatArray,
    resolution: int,
) -> PicturedRays:
    order = np.argsort(tiles, kind="stable")
    rays, tiles = rays[order], tiles[order]
    turned = np.einsum("nij,nj->ni", pictures.views[tiles, :3, :3], directions[rays])
    ahead = turned[:, 2] < 0.0
    rays, tiles, turned = rays[ahead], tiles[ahead], turned[ahead]
    tangents = turned[:, :2] / -turned[:, 2:]
    frusta = pictures.frusta
    low = np.stack([frusta.left, frusta.bottom], axis=1)[tiles]
    high = np.stack([frusta.right, frusta.top], axis=1)[tiles]
    pixels = (tangents - low) / (high - low) * resolution
    within = ((pixels > 0.0) & (pixels < resolution)).all(axis=1)
    return PicturedRays(tiles_per_eye, pictures, rays[within], tiles[within], pixels[within])


def seen_around(gl: GlContext, depth_pass: DepthPass, pictured: PicturedRays) -> IntArray:
    """Draw the pictures and return the faces around each ray, (r, `PIXELS_PER_RAY`), by rank in drawing order."""
    atlas = depth_pass.atlas
    batches = parts(len(pictured.pictures), atlas.n_tiles)
    tiles = arrange_tiles(pictured.pictures, atlas.resolution, atlas.columns, batches[0].stop)
    lowest = np.floor(pictured.pixels - 1.5).astype(np.int32) + tiles["corner"][pictured.tiles, :2].astype(np.int32)
    seen = np.empty((len(pictured.rays), PIXELS_PER_RAY), dtype=np.int32)
    program = gl.program("candidates.comp")
    for batch in batches:
        padded = np.zeros(MAX_TILES, dtype=TILE)
        padded[: batch.stop - batch.start] = tiles[batch]
        first, last = np.searchsorted(pictured.tiles, [batch.start, batch.stop])
        with Buffers(gl, tiles=padded) as buffers:
            buffers.bind_uniforms("tiles", 0, offset=0, size=padded.nbytes)
            depth_pass.draw(batch.stop - batch.start)
            atlas.use(depths=0, faces=1)
            for part in parts(last - first, block_limit(gl) // (4 * PIXELS_PER_RAY)) if last > first else ():
                rays = slice(first + part.start, first + part.stop)
                _gather(gl, program, lowest[rays], seen[rays])
    return seen


def _gather(gl: GlContext, program: Any, lowest: NDArray[np.int32], seen: IntArray) -> None:
    set_uniforms(program, n_rays=len(lowest))
    with Buffers(gl, rays=lowest, seen=seen.nbytes) as buffers:
        buffers.bind(rays=0, seen=1)
        program.run(-(-len(lowest) // _LANES))
        buffers.read_into("seen", seen)


def nearest_of(
    candidates: IntArray, corners: FloatArray, origins: FloatArray, directions: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Test each ray (world space) against its candidates, (n, c) face ids or -1, in float64.

    Returns the nearest face that each ray meets, the lowest among equally near ones, -1 for none; and its distance as a
    multiple of the direction, infinite for none.
    """
    face_ids = np.full(len(origins), -1, dtype=np.int32)
    fractions = np.full(len(origins), np.inf)
    n_tasks = n_blocks(len(origins), BLOCK)
    parallel_for(_choose, n_tasks, candidates, corners, origins, directions, face_ids, fractions)
    return face_ids, fractions


@parallel_kernel
def _choose(tasks, candidates, corners, origins, directions, face_ids, fractions):
    """Find the nearest candidate of blocks of rays."""
    first, last = take_block(tasks, len(origins), BLOCK)
    while first < last:
        for i in range(first, last):
            for j in range(candidates.shape[1]):
                face = candidates[i, j]
                if face < 0 or face == face_ids[i]:
                    continue
                f = corners[face]
                at, _ = ray_triangle_t(origins[i], directions[i], f[0], f[1], f[2])
                if at < fractions[i] or (at == fractions[i] and at < np.inf and face < face_ids[i]):
                    face_ids[i], fractions[i] = face, at
        first, last = take_block(tasks, len(origins), BLOCK)
