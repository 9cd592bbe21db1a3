"""`depth_buffer`: OpenGL draws the mesh into a depth buffer for each eye and tests the points against it."""

from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import OptionError, check_choice, check_fraction
from zbuf_occlude.engines.gl.buffers import Buffers, answer_limit, parts
from zbuf_occlude.engines.gl.depth_pass import MAX_TILES, DepthPass, arrange_mesh, mesh_buffers
from zbuf_occlude.engines.gl.point_pass import MAX_HIDDEN, MAX_POINTS, PointPass, UploadedPoints, batches_of
from zbuf_occlude.engines.gl.ray_pass import PIXELS_PER_RAY, nearest_of, picture_rays, seen_around
from zbuf_occlude.engines.gl.shaders import set_uniforms
from zbuf_occlude.engines.gl.tiles import (
    CUBE,
    EYES_PER_BYTE,
    TILE,
    Pictures,
    Unit,
    arrange_tiles,
    cube_pictures,
    single_pictures,
)
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery, check_count

REFINEMENTS = ("witness", "none")

MIN_RESOLUTION, MAX_RESOLUTION = 16, 8192
"""Bounds of the resolution, pixels along a side. Six cube faces of 8192 pixels take 3.2 GB."""


def prepare(
    mesh: Mesh,
    *,
    gl: Any,
    resolution: int = 512,
    tolerance: float = 1e-4,
    slope_bias: float = 0.5,
    refine: str = "witness",
) -> "DepthBuffer":
    """Put a mesh on the GPU.

    Parameters
    ----------
    mesh : Mesh
    gl : GlContext
    resolution : int
        Pixels along a side of the depth buffer, which is fitted to the mesh.
    tolerance : float
        Depth by which a visible point may lie behind the buffer, as a fraction of the mesh's diagonal.
    slope_bias : float
        With ``refine="none"``, additional tolerance, in units of the depth that the point's own plane gains from one
        pixel to the next. "witness" evaluates that plane at the pixels' centres and needs no bias.
    refine : {"witness", "none"}
        Treatment of points near silhouettes and creases; see `DepthBuffer`.

    Raises
    ------
    OptionError
        A value is out of range.
    GlError
        The driver lacks a feature, or has no memory left.
    """
    check_count("resolution", resolution, MIN_RESOLUTION, MAX_RESOLUTION, "pixels along a side")
    check_fraction("tolerance", tolerance)
    if not 0.0 <= slope_bias < np.inf:
        raise OptionError(f"slope_bias must not be negative and be finite, in pixels; got {slope_bias}.")
    check_choice("refine", refine, REFINEMENTS)
    return DepthBuffer(mesh, gl, int(resolution), tolerance, slope_bias, refine == "witness")


class DepthBuffer(VisibilityQuery):
    """Shadow mapping with the eye as the light, and points instead of pixels.

    Notes
    -----
    The frustum is fitted to the mesh; an eye within the mesh, or too near for one frustum, gets six cube faces. Points
    outside the picture are visible. Not exact: the buffer holds one depth per pixel.

    ``refine="none"`` compares a point's depth with that of its pixel. Its error is the pixel times a slope: 1.5 to 4 %
    of the answers on CAD meshes at 512 pixels a side.

    ``refine="witness"`` compares the buffer with the point's own plane at the centres of the four pixels around the
    point. All four agree for 93 to 98 % of the answers; that answer is wrong in less than one of 5,000 cases.
    Otherwise the faces in the 6 x 6 pixels around the point are tested against the line of sight; a face that crosses
    it is a witness, and hides the point. Without a witness the pixels' votes are weighted by nearness. The remaining
    errors, 0.05 to 1 % of the answers, lie near silhouettes, where the hiding face is in no pixel.

    Sheets nearer to each other than `tolerance` cannot be told apart: on an open plate thinner than that a third of the
    answers may be wrong. Faces nearer than 1e-6 diagonals to an eye inside the mesh are not drawn.

    First hits use pictures from the rays' origins. The faces in the 4 x 4 pixels around a ray are tested in float64,
    and the nearest hit is the answer. It is wrong if the true face is in none of these pixels.

    Costs a draw of f triangles for each eye and some arithmetic for each point. Memory: 12 bytes per vertex, 72 bytes
    per face, 256 MiB for the pictures of a batch of eyes (16 MiB if a CPU draws), 32 bytes per point, kept until other
    points are asked about, and at most 128 MiB of answers per million points.

    References
    ----------
    Williams: Casting curved shadows on curved surfaces. SIGGRAPH 1978, doi:10.1145/965139.807402.
    Reeves, Salesin, Cook: Rendering antialiased shadows with depth maps. SIGGRAPH 1987, doi:10.1145/37402.37435
    (votes of several pixels). Paper section 5 leaves image space open.
    """

    def __init__(
        self, mesh: Mesh, gl: Any, resolution: int, tolerance: float, slope_bias: float, witness: bool
    ) -> None:
        super().__init__(mesh)
        self._gl, self.renderer = gl, gl.renderer
        self._resolution, self.tolerance = resolution, tolerance * mesh.diagonal
        gl.make_current()
        self._unit = Unit.from_box(mesh.centre, mesh.diagonal)
        diagonal = mesh.diagonal * self._unit.scale
        self._witness = witness
        self._criteria = {
            "tolerance": np.float32(tolerance * diagonal),
            "slope_bias": np.float32(slope_bias),
            "contact": CONTACT * diagonal,
        }
        self._arrays = arrange_mesh(mesh, self._unit)
        self._mesh_buffers = mesh_buffers(gl, self._arrays)
        self._passes: dict[tuple[int, bool], DepthPass] = {}
        self._uploaded: tuple[SurfacePoints, list[UploadedPoints]] | None = None

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        self._gl.make_current()
        uploaded = self._upload(points)
        mask = np.empty((len(eyes), len(points)), dtype=np.bool_)
        local = self._unit.to(eyes)
        fits, pictures = single_pictures(local, self._arrays.positions, self._resolution)
        if fits.all():
            self._answer(uploaded, pictures, 1, mask)
        else:
            if fits.any():
                mask[fits] = self._answer(uploaded, pictures, 1, mask[fits])
            pictures = cube_pictures(local[~fits], self._arrays.positions, self._resolution)
            mask[~fits] = self._answer(uploaded, pictures, CUBE, mask[~fits])
        self._gl.check()
        return mask

    def _upload(self, points: SurfacePoints) -> list[UploadedPoints]:
        """Upload points to the GPU, in parts, unless they are the last ones uploaded: points are immutable."""
        if self._uploaded is None or self._uploaded[0] is not points:
            self._forget()
            uploaded: list[UploadedPoints] = []
            try:
                for part in parts(len(points), MAX_POINTS):
                    positions, own = points.positions[part], points.face_ids[part]
                    uploaded.append(UploadedPoints(self._gl, positions, own, self._arrays, self._unit))
            except BaseException:
                for each in uploaded:
                    each.release()
                raise
            self._uploaded = points, uploaded
        return self._uploaded[1]

    def _forget(self) -> None:
        if self._uploaded is not None:
            for part in self._uploaded[1]:
                part.release()
            self._uploaded = None

    def _answer(
        self, points: list[UploadedPoints], pictures: Pictures, tiles_per_eye: int, out: BoolArray
    ) -> BoolArray:
        """Answer for eyes that all have `tiles_per_eye` tiles, into (k, n) bool."""
        depth_pass = self._pass(tiles_per_eye)
        # each group of eyes of a batch takes a byte per point
        groups = -(-depth_pass.n_eyes // EYES_PER_BYTE) * max(part.n_slots for part in points)
        most = max(1, answer_limit(self._gl) // groups) * depth_pass.n_eyes
        for first in range(0, len(out), most):
            these = slice(first * tiles_per_eye, (first + most) * tiles_per_eye)
            self._answer_some(points, depth_pass, pictures.select(these), tiles_per_eye, out[first : first + most])
        return out

    def _answer_some(
        self,
        points: list[UploadedPoints],
        depth_pass: DepthPass,
        pictures: Pictures,
        tiles_per_eye: int,
        out: BoolArray,
    ) -> None:
        """Answer for at most as many eyes as the buffer of answers holds."""
        batches = batches_of(len(out), depth_pass.n_eyes)
        in_batch = batches[0].n_eyes * tiles_per_eye
        tiles = arrange_tiles(pictures, self._resolution, depth_pass.atlas.columns, in_batch)
        padded = np.zeros((len(batches), MAX_TILES), dtype=TILE)
        for row, first in zip(padded, range(0, len(tiles), in_batch), strict=True):
            some = tiles[first : first + in_batch]
            row[: len(some)] = some
        passes: list[PointPass] = []
        with Buffers(self._gl, tiles=padded) as buffers:
            try:
                first = 0
                for part in points:
                    mine = out[:, first : first + len(part)]
                    first += len(part)
                    passes.append(PointPass(self._gl, part, mine, batches, doubts=self._witness))
                depth_pass.atlas.use(depths=0, faces=1)
                self._mesh_buffers.bind(corners=4)
                for i, batch in enumerate(batches):
                    buffers.bind_uniforms("tiles", 0, offset=i * padded[0].nbytes, size=padded[0].nbytes)
                    depth_pass.draw(batch.n_eyes * tiles_per_eye)
                    programs = self._programs(tiles_per_eye, depth_pass, batch.n_eyes)
                    for each in passes:
                        each.test(batch, *programs)
                for each in passes:
                    each.fetch()
            finally:
                for each in passes:
                    each.release()

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        self._gl.make_current()
        lengths = np.linalg.norm(directions, axis=1)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape))
        candidates = np.full((len(directions), PIXELS_PER_RAY), -1, dtype=np.int32)
        drawn = np.append(np.argsort(self._arrays.ranks), -1).astype(np.int32)  # faces in drawing order; the last: none
        units = directions / lengths[:, None]
        for group in picture_rays(self._unit.to(origins), units, self._arrays.positions, self._resolution):
            depth_pass = self._pass(group.tiles_per_eye, ids=True)
            candidates[group.rays] = drawn[seen_around(self._gl, depth_pass, group)]
        self._gl.check()
        face_ids, fractions = nearest_of(candidates, self.mesh.corners, origins, directions)
        return FirstHits(face_ids, fractions * lengths)

    def _pass(self, tiles_per_eye: int, ids: bool | None = None) -> DepthPass:
        ids = self._witness if ids is None else ids
        if (tiles_per_eye, ids) not in self._passes:
            self._passes[tiles_per_eye, ids] = DepthPass(
                self._gl, self._mesh_buffers, self._resolution, ids=ids, tiles_per_eye=tiles_per_eye
            )
        return self._passes[tiles_per_eye, ids]

    def _programs(self, tiles_per_eye: int, depth_pass: DepthPass, n_eyes: int) -> list[Any]:
        """Return the programs for a batch of `n_eyes` eyes: one that answers, and one that decides doubtful pairs."""
        constants = {"TILES": MAX_TILES, "CUBE": int(tiles_per_eye == CUBE)}
        eyes = min(n_eyes, EYES_PER_BYTE)  # a program computes all its eyes, including padding
        if self._witness:
            programs = [
                self._gl.program("vote.comp", EYES=eyes, **constants),
                self._gl.program("witness.comp", MAX_HIDDEN=MAX_HIDDEN, **constants),
            ]
        else:
            programs = [self._gl.program("depth_test.comp", EYES=eyes, **constants)]
        width, height = depth_pass.atlas.size
        for program in programs:
            set_uniforms(program, texel=(1.0 / width, 1.0 / height), **self._criteria)
        return programs

    def _release(self) -> None:
        self._gl.make_current()
        self._forget()
        for depth_pass in self._passes.values():
            depth_pass.release()
        self._passes.clear()
        self._mesh_buffers.release()
