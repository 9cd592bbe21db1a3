"""Every operation on 16 and on 32 lanes against its plain twin in NumPy, NaN, infinity and minus zero included."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from zbuf_occlude.base.jit import simd
from zbuf_occlude.base.jit.simd import load, load_wide, store

RNG = np.random.default_rng(0)
SPECIAL = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1.0, -1.0, 3e-39], dtype=np.float32)
A = np.concatenate([RNG.normal(size=24).astype(np.float32), np.repeat(SPECIAL, 8)])
B = np.concatenate([RNG.normal(size=24).astype(np.float32), np.tile(SPECIAL, 8)])
STARTS = range(0, len(A) - 31, 5)  # not aligned to anything
WIDTHS = pytest.mark.parametrize(("n", "load"), [(16, load), (32, load_wide)], ids=["16", "32"])


def bits(bools: np.ndarray) -> int:
    return sum(1 << i for i in range(len(bools)) if bools[i])


TWINS = (
    np.add,
    np.subtract,
    np.multiply,
    np.divide,
    lambda a, b: np.where(a < b, a, b),
    lambda a, b: np.where(a > b, a, b),
)


@WIDTHS
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_two_vectors_to_one_and_to_a_mask(n, load) -> None:
    @njit
    def kernel(a, b, out, i):
        u, v = load(a, i), load(b, i)
        store(out[0], i, u + v)
        store(out[1], i, u - v)
        store(out[2], i, u * v)
        store(out[3], i, simd.divide(u, v))
        store(out[4], i, simd.minimum(u, v))
        store(out[5], i, simd.maximum(u, v))
        return simd.greater(u, v), simd.not_less(u, v)

    for i in STARTS:
        out = np.zeros((len(TWINS), len(A)), dtype=np.float32)
        masks = kernel(A, B, out, i)
        for found, twin in zip(out, TWINS, strict=True):
            np.testing.assert_array_equal(found[i : i + n], twin(A, B)[i : i + n])
        assert not out[:, :i].any()
        assert not out[:, i + n :].any()
        assert masks == (bits((A > B)[i : i + n]), bits(~(A < B)[i : i + n]))


@WIDTHS
def test_a_number_stands_in_all_lanes(n, load) -> None:
    @njit
    def kernel(a, b, mask, out):
        number, v = simd.load_scalar(b, 5), load(a, 0)
        store(out, 0, number - v)
        store(out, n, v * number)
        store(out, 2 * n, simd.minimum(number, v))
        store(out, 3 * n, simd.muladd(number, v, number))
        store(out, 4 * n, simd.blend(mask, number, v))
        return simd.greater(v, number), simd.not_less(number, v)

    a, b = RNG.normal(size=(2, n)).astype(np.float32)
    out, mask = np.empty((5, n), dtype=np.float32), RNG.random(n) < 0.5
    assert kernel(a, b, bits(mask), out.reshape(-1)) == (bits(a > b[5]), bits(b[5] >= a))
    np.testing.assert_array_equal(out[:3], [b[5] - a, a * b[5], np.minimum(a, b[5])])
    np.testing.assert_allclose(out[3], b[5] * a + b[5], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(out[4], np.where(mask, b[5], a))


def test_two_widths_are_not_mixed() -> None:
    @njit
    def kernel(a):
        return simd.greater(load(a, 0), load_wide(a, 0))

    with pytest.raises(TypingError):
        kernel(A)


@WIDTHS
def test_muladd_rounds_once_or_twice(n, load) -> None:
    @njit
    def kernel(a, b, c, out):
        store(out, 0, simd.muladd(load(a, 0), load(b, 0), load(c, 0)))

    a, b, c = (RNG.normal(size=n).astype(np.float32) for _ in range(3))
    out = np.empty(n, dtype=np.float32)
    kernel(a, b, c, out)
    once = (a.astype(np.float64) * b + c).astype(np.float32)
    assert ((out == once) | (out == a * b + c)).all()


@WIDTHS
def test_one_vector(n, load) -> None:
    @njit
    def kernel(a, out):
        v = load(a, 0)
        store(out, 0, simd.absolute(v))
        store(out, n, simd.square_root(simd.absolute(v)))
        store(out, 2 * n, simd.splat(a[3]))
        return simd.lowest(v), simd.highest(v)

    for _ in range(20):
        a = RNG.normal(size=n).astype(np.float32)
        out = np.empty(2 * n + 16, dtype=np.float32)
        assert kernel(a, out) == (a.min(), a.max())
        np.testing.assert_array_equal(out, np.concatenate([np.abs(a), np.sqrt(np.abs(a)), np.full(16, a[3])]))


def test_masks() -> None:
    @njit
    def kernel(mask, a, b, ids, out):
        store(out, 0, simd.blend(mask, load(a, 0), load(b, 0)))
        simd.store_masked(ids, 2, mask, np.int32(7))
        return simd.first_lane(mask), simd.count_lanes(mask)

    out = np.empty(16, dtype=np.float32)
    for bools in RNG.random((20, 16)) < 0.4:
        bools[int(RNG.integers(16))] = True
        ids = RNG.integers(-1, 3, 18).astype(np.int32)
        before = ids.copy()
        first, count = kernel(bits(bools), A, B, ids, out)
        assert (first, count) == (np.flatnonzero(bools)[0], bools.sum())
        assert ids.tolist() == [*before[:2], *np.where(bools, 7, before[2:])]
        np.testing.assert_array_equal(out, np.where(bools, A[:16], B[:16]))


def test_wide_masks() -> None:
    @njit
    def kernel(mask, a, b, ids, value, out):
        store(out, 0, simd.blend(mask, load_wide(a, 0), load_wide(b, 0)))
        return simd.first_lane(mask), simd.count_lanes(mask), simd.equal_wide(ids, 2, value)

    out = np.empty(32, dtype=np.float32)
    for bools in RNG.random((20, 32)) < 0.3:
        bools[int(RNG.integers(32))] = True
        ids = RNG.integers(-1, 3, 34).astype(np.int32)
        first, count, same = kernel(bits(bools), A, B, ids, -1, out)
        assert (first, count, same) == (np.flatnonzero(bools)[0], bools.sum(), bits(ids[2:] == -1))
        np.testing.assert_array_equal(out, np.where(bools, A[:32], B[:32]))


def test_fetching_changes_nothing_and_may_go_beyond_the_end() -> None:
    @njit
    def kernel(a, index):
        simd.prefetch(a, index)
        return a[0]

    a = np.arange(16, dtype=np.float32)
    for index in (0, 15, 1 << 40):
        assert kernel(a, index) == 0.0
    assert a.tolist() == list(range(16))


def test_strided_arrays_are_refused() -> None:
    @njit
    def kernel(a, out):
        store(out, 0, load(a, 0))

    with pytest.raises(TypingError, match="lanes must be taken from a C-contiguous float32 array"):
        kernel(np.ones((16, 2), dtype=np.float32)[:, 0], np.empty(16, dtype=np.float32))
    with pytest.raises(TypingError, match="lanes must be taken from a C-contiguous float32 array"):
        kernel(np.ones(16), np.empty(16, dtype=np.float32))


def test_three_vectors_at_a_time() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 3, 16)).astype(np.float32)
    matrix = rng.normal(size=12).astype(np.float32)

    @njit
    def kernel(a, b, matrix, out):  # type: ignore[no-untyped-def]
        u, v = simd.load3(a, 0, 16), simd.load3(b, 0, 16)
        store(out, 0, -simd.dot3(u, v))
        simd.store3(out, 16, 16, simd.cross3(u, v))
        simd.store3(out, 64, 16, simd.transform(matrix, u[0], u[1], u[2]))
        simd.store3(out, 112, 16, simd.splat3((matrix[0], matrix[1], matrix[2])))
        out[160:163] = simd.load_scalar3(matrix, 1, 4)
        simd.store3(out, 176, 16, simd.cross3_add(u, v, u))

    out = np.zeros((14, 16), dtype=np.float32)
    kernel(a, b, matrix, out.reshape(-1))
    rows = matrix.reshape(3, 4)
    np.testing.assert_allclose(out[0], -(a * b).sum(axis=0), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(out[1:4], np.cross(a, b, axis=0), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(out[4:7], rows[:, :3] @ a + rows[:, 3:], rtol=1e-5, atol=1e-5)
    assert np.array_equal(out[7:10], np.repeat(matrix[:3, None], 16, axis=1))
    assert np.array_equal(out[10, :3], rows[:, 1])
    np.testing.assert_allclose(out[11:14], np.cross(a, b, axis=0) + a, rtol=1e-5, atol=1e-5)
