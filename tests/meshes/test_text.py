"""Numbers in text are read as Python's float reads them, bit for bit; what is none is refused."""

import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zbuf_occlude import MeshError
from zbuf_occlude.meshes.text import Lines


def read(*tokens: str) -> list[bytes]:
    numbers = Lines("\n".join(tokens).encode()).numbers()
    return [struct.pack("<d", number) for number in numbers.tolist()]


def as_python(*tokens: str) -> list[bytes]:
    return [struct.pack("<d", float(token)) for token in tokens]


def spellings(rng: random.Random) -> str:
    kind = rng.randrange(6)
    if kind == 0:
        return repr(rng.uniform(-1, 1) * 10.0 ** rng.randint(-320, 308))
    if kind == 1:
        return f"{rng.uniform(-1000, 1000):.{rng.randint(0, 25)}f}"
    if kind == 2:
        return f"{rng.randint(0, 10 ** rng.randint(1, 24))}e{rng.randint(-350, 310)}"
    if kind == 3:
        return f"{rng.uniform(-10, 10):+.{rng.randint(0, 17)}E}"
    if kind == 4:  # half way between two float64, exactly where its digits allow
        return str((2 * (rng.getrandbits(52) | 1 << 52) + 1) * 5 ** rng.randint(0, 4)) + f"e-{rng.randint(0, 4)}"
    return "0" * rng.randint(0, 30) + str(rng.getrandbits(60)) + "." + "0" * rng.randint(0, 30)


def test_twenty_thousand_spellings_are_read_as_python_reads_them() -> None:
    rng = random.Random(0)
    tokens = [spellings(rng) for _ in range(20_000)]
    assert read(*tokens) == as_python(*tokens)


@given(st.lists(st.floats(allow_nan=False), min_size=1))
@settings(max_examples=200)
def test_every_float_is_read_back(numbers: list[float]) -> None:
    assert read(*map(repr, numbers)) == [struct.pack("<d", number) for number in numbers]


def test_odd_spellings() -> None:
    tokens = ["0", "-0", "-0.0", "+.5", "5.", "1e5", "1E+05", "1e-400", "1e400", "-1e999999999999", "inf", "-Infinity"]
    tokens += ["4.9e-324", "2e-324", "2.2250738585072011e-308", "1.7976931348623159e308", "9007199254740993"]
    assert read(*tokens) == as_python(*tokens)
    assert np.isnan(Lines(b"nan -NaN nan(ind) -nan(0x7f)").numbers()).all()


@pytest.mark.parametrize(
    "token", ["1.2.3", "--1", "1e", "e5", ".", "-", "0x10", "1_000", "1,5", "1d3", "1e5.", "½", "1/2"]
)
def test_what_is_no_number_is_quoted(token: str) -> None:
    with pytest.raises(MeshError, match="must have numbers here; it has "):
        read("1", token, "2")
