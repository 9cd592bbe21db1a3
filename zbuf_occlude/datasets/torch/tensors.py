"""Exact lines of sight and rays of tensors, answered on the device where the tensors are (extra ``warp``)."""

from typing import Any
from weakref import WeakKeyDictionary

import torch

from zbuf_occlude.base.arrays import LARGEST
from zbuf_occlude.base.errors import ArgumentError, MeshError, check_fraction
from zbuf_occlude.base.extras import importing
from zbuf_occlude.visibility.interface import CONTACT, FirstHits


def visible(
    vertices: torch.Tensor,
    faces: torch.Tensor,
    points: torch.Tensor,
    face_ids: torch.Tensor,
    eyes: torch.Tensor,
    *,
    contact: float = CONTACT,
) -> torch.Tensor:
    """Answer which points each eye sees, on the tensors' device.

    Parameters
    ----------
    vertices : (v, 3) float tensor
        World space, any unit; on the CPU or on a CUDA device, as all others.
    faces : (f, 3) int tensor
        Indices into `vertices`.
    points : (n, 3) float tensor
        World space.
    face_ids : (n,) int tensor
        The face that each point lies on, which never hides it; -1: none.
    eyes : (k, 3) or (3,) float tensor
        Centres of projection, world space; anywhere but on the surface.
    contact : float
        The contact tolerance, a fraction of the diagonal of the mesh's bounding box.

    Returns
    -------
    (k, n) bool tensor, True = visible; (n,) of one eye (3,).

    Raises
    ------
    ArgumentError
        A tensor of another shape, type or device; faces that index no vertex.
    MeshError
        A mesh without faces, with positions that are not finite or beyond 1e70, or smaller than 1e-70.
    OptionError
        `contact` is out of range.
    UnavailableError
        Warp is not installed.

    Notes
    -----
    Exact for the numbers given (docs/conventions.md). Points of float32 lie that much off their faces.

    A mesh is checked and prepared when it is first seen, and kept while the memory of both tensors lives. It is known
    by its memory: new views find it again. It is prepared again after PyTorch's operations in place, and where
    ``.data`` was set. Writes in place through ``.data`` or NumPy cannot be seen: pass a clone after them. Tensors made
    in inference mode are prepared at every call. Preparing waits for the device once. A later call waits for one
    number: how many lines of sight float64 leaves in doubt. If there are some, mesh and points are copied to the host,
    where `exact` decides them. Other values are not checked. No gradient passes. CUDA is untested.

    Examples
    --------
    >>> vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]])
    >>> points = torch.tensor([[0.1, 0.1, 0.0], [0.1, 0.1, 1.0]])
    >>> faces, face_ids = torch.tensor([[0, 1, 2], [3, 4, 5]]), torch.tensor([0, 1])
    >>> zo.torch.visible(vertices, faces, points, face_ids, torch.tensor([0.2, 0.2, 9.0])).tolist()
    [False, True]
    """
    check_fraction("contact", contact)
    mesh = tensor_mesh(vertices, faces)
    mask = mesh.visible(
        checked("points", points, (-1, 3), vertices.device),
        checked("face_ids", face_ids, (len(points),), vertices.device, torch.int32),
        checked("eyes", eyes[None] if getattr(eyes, "ndim", 0) == 1 else eyes, (-1, 3), vertices.device),
        contact,
    )
    return mask[0] if eyes.ndim == 1 else mask


def first_hits(
    vertices: torch.Tensor, faces: torch.Tensor, origins: torch.Tensor, directions: torch.Tensor
) -> FirstHits:
    """Answer which face each ray meets first, and how far away, on the tensors' device.

    Parameters
    ----------
    vertices, faces : tensors
        As `visible` takes them.
    origins : (n, 3) or (1, 3) float tensor
        World space; one origin serves all rays.
    directions : (n, 3) float tensor
        World space, of any length but 0.

    Returns
    -------
    FirstHits
        Of tensors: (n,) int32, -1 where a ray meets nothing; (n,) float64 eye distances in world units, infinity there.
        The nearest face, the lowest face id of those equally near. A direction of length 0, or not finite, meets none.

    Raises
    ------
    ArgumentError
        A tensor of another shape, type or device; faces that index no vertex.
    MeshError, UnavailableError
        As `visible`.

    Notes
    -----
    As `visible`: exact, kept on the device, untested on CUDA.

    Examples
    --------
    >>> vertices, faces = torch.eye(3), torch.tensor([[0, 1, 2]])
    >>> hits = zo.torch.first_hits(vertices, faces, torch.zeros(1, 3), torch.tensor([[1.0, 1, 1], [1.0, 0, -1]]))
    >>> hits.face_ids.tolist(), round(hits.distances[0].item(), 6)
    ([0, -1], 0.57735)
    """
    mesh, device = tensor_mesh(vertices, faces), vertices.device
    directions = checked("directions", directions, (-1, 3), device)
    n_origins = 1 if is_dense(origins) and origins.shape[:1] == (1,) else len(directions)
    return FirstHits(*mesh.first_hits(checked("origins", origins, (n_origins, 3), device), directions))


class TensorMesh:
    """A mesh prepared on its device: its corners (f, 3 corners, 3), its bounds (2, 3), and its engine."""

    def __init__(self, vertices: torch.Tensor, faces: torch.Tensor) -> None:
        with importing("warp", "visibility of tensors"):
            import warp

            from zbuf_occlude.engines.warp import DeviceBvh
        device = vertices.device if isinstance(vertices, torch.Tensor) else torch.device("cpu")
        if device.type not in ("cpu", "cuda"):
            raise ArgumentError(f"tensors must be on the CPU or on a CUDA device; these are on {device}. Move them.")
        vertices = checked("vertices", vertices, (-1, 3), device)
        rows = checked("faces", faces, (-1, 3), device, torch.int64).reshape(-1)
        if not len(vertices) or not len(rows):
            raise MeshError(f"a mesh must have vertices and faces; it has {len(vertices)} and {len(rows) // 3}.")
        corners = vertices.index_select(0, rows.clamp(0, len(vertices) - 1))
        self.corners, self.bounds = corners.view(-1, 3, 3), torch.stack([corners.amin(dim=0), corners.amax(dim=0)])
        low, high = rows.aminmax()
        is_indexed = (low >= 0) & (high < len(vertices))
        lower, upper = self.bounds  # beyond either limit, products of four lengths overflow or vanish
        is_measured = (self.bounds.abs() <= LARGEST).all() & ((upper - lower).amax() >= 1.0 / LARGEST)
        if not (is_indexed & is_measured):
            if is_indexed:
                raise MeshError(
                    f"a mesh must have finite positions, none beyond {LARGEST:g}, and be at least {1.0 / LARGEST:g} "
                    f"long; this one lies from {lower.tolist()} to {upper.tolist()}. Rescale or repair it."
                )
            raise ArgumentError(f"faces must lie in [0, {len(vertices)}); got values from {int(low)} to {int(high)}.")
        self._warp = warp
        with self._stream():
            self._bvh = DeviceBvh(self._shared(corners), self._shared(self.bounds))

    def visible(self, points: torch.Tensor, face_ids: torch.Tensor, eyes: torch.Tensor, contact: float) -> torch.Tensor:
        """Return which of n points, own faces int32, each of k eyes sees; (k, n) bool."""
        mask = torch.ones((len(eyes), len(points)), dtype=torch.uint8, device=points.device)
        if mask.numel():
            with self._stream():
                shared = self._shared
                self._bvh.fill_visible(shared(points), shared(face_ids), shared(eyes), contact, shared(mask))
        return mask.view(torch.bool)

    def first_hits(self, origins: torch.Tensor, directions: torch.Tensor) -> tuple[Any, Any]:
        """Return the faces that n rays meet first, (n,) int32, and how far, (n,) float64."""
        exponents = torch.frexp(directions.abs().amax(dim=1, keepdim=True)).exponent.clamp(-1000, 1000)
        exponents = exponents.masked_fill(exponents.abs() < 64, 0)  # of usual length (`arrays.SHORTEST`)
        directions = directions * torch.exp2(-exponents.double())
        face_ids = torch.empty(len(directions), dtype=torch.int32, device=directions.device)
        distances = torch.empty(len(directions), dtype=torch.float64, device=directions.device)
        if len(directions):
            with self._stream():
                rays = self._shared(origins), self._shared(directions)
                self._bvh.fill_first_hits(*rays, self._shared(face_ids), self._shared(distances))
        return face_ids, distances

    def _stream(self) -> Any:
        """Order Warp's work after PyTorch's earlier work on the same device."""
        device = self.corners.device
        stream = self._warp.stream_from_torch(torch.cuda.current_stream(device)) if device.type == "cuda" else None
        return self._warp.ScopedStream(stream)

    def _shared(self, tensor: torch.Tensor) -> Any:
        """Return a tensor's memory as an array of Warp's."""
        is_vectors = tensor.ndim == 2 and tensor.is_floating_point()
        return self._warp.from_torch(tensor, dtype=self._warp.vec3d if is_vectors else None)


_meshes = WeakKeyDictionary[Any, WeakKeyDictionary[Any, dict[Any, tuple[Any, TensorMesh]]]]()
"""Prepared meshes, with the versions of their tensors, by memory of vertices, memory of faces and layout."""


def tensor_mesh(vertices: torch.Tensor, faces: torch.Tensor) -> TensorMesh:
    """Return the prepared mesh of the same unchanged memory, or prepare one."""
    if not (is_followed(vertices) and is_followed(faces)):
        return TensorMesh(vertices, faces)
    of_vertices = _meshes.setdefault(vertices.untyped_storage(), WeakKeyDictionary())
    known = of_vertices.setdefault(faces.untyped_storage(), {})
    place, versions = (place_of(vertices), place_of(faces)), (vertices._version, faces._version)
    if place not in known or known[place][0] != versions:
        known[place] = versions, TensorMesh(vertices, faces)
    return known[place][1]


def is_dense(values: Any) -> bool:
    """Return whether a value is a tensor whose numbers lie in memory; those of sparse and nested ones do not."""
    return isinstance(values, torch.Tensor) and values.layout == torch.strided and not values.is_nested


def is_followed(values: Any) -> bool:
    """Return whether a value is a tensor that counts its changes in place; those made in inference mode do not."""
    return is_dense(values) and not values.is_inference()


def place_of(tensor: torch.Tensor) -> tuple[object, ...]:
    """Return the layout of a tensor in its memory."""
    return tensor.data_ptr(), tensor.shape, tensor.stride(), tensor.dtype, tensor.device, tensor.is_neg()


def checked(
    name: str, values: Any, shape: tuple[int, ...], device: torch.device, dtype: torch.dtype = torch.float64
) -> torch.Tensor:
    """Return a tensor as float64, int64, or int32, where larger numbers become the largest and negative ones -1.

    Raise ArgumentError unless it has a shape, -1 for any length, and device.
    """
    fits = is_dense(values) and values.device == device and values.ndim == len(shape)
    fits = fits and all(wanted in (-1, length) for wanted, length in zip(shape, values.shape, strict=True))
    kind = "float" if dtype.is_floating_point else "int"
    is_int = fits and not (values.is_floating_point() or values.is_complex() or values.dtype == torch.bool)
    if not fits or not (values.is_floating_point() if dtype.is_floating_point else is_int):
        want = f"({', '.join('n' if length < 0 else str(length) for length in shape)}{',' * (len(shape) == 1)})"
        got = type(values).__name__
        if is_dense(values):
            got = f"{tuple(values.shape)} {str(values.dtype).removeprefix('torch.')} on {values.device}"
        elif isinstance(values, torch.Tensor):
            got = "one that is sparse or nested"
        raise ArgumentError(f"{name} must be a {want} {kind} tensor on {device}; got {got}.")
    values = values.detach().resolve_neg()
    if dtype == torch.int32 and values.dtype != dtype:  # a number that wrapped around would name another face
        values = values.to(torch.int64).clamp(-1, torch.iinfo(dtype).max)
    return values.to(dtype).contiguous()
