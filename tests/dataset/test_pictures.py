"""Pictures that somebody made: what is no frame is refused by what its header says, before it costs anything."""

import contextlib
import io
import struct
import subprocess
import tracemalloc
import zlib

import numpy as np
import pytest
from PIL import Image

from lerobot_spacedock.dataset.sources.pictures import LARGEST_PIXELS, decode_picture, read_picture
from lerobot_spacedock.errors import FileFormatError


def encoded(kind: str, mode: str = "RGB", size: tuple[int, int] = (16, 12)) -> bytes:
    values = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    stream = io.BytesIO()
    Image.fromarray(values).convert(mode).save(stream, kind)
    return stream.getvalue()


def claiming(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header says so, with a right checksum."""
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    good = encoded("png")
    return good[:12] + body + struct.pack(">I", zlib.crc32(body)) + good[33:]


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P"])
def test_every_colour_mode_becomes_rgb(mode, tmp_path):
    (tmp_path / "a.png").write_bytes(encoded("png", mode))
    picture = read_picture(tmp_path / "a.png")
    assert (picture.shape, picture.dtype) == ((12, 16, 3), np.uint8)
    np.testing.assert_array_equal(decode_picture(encoded("png", mode) + b"\0" * 9, "here"), picture)


@pytest.mark.parametrize(("width", "height"), [(4097, 4096), (1000, 50_000), (16_385, 16_384), (2**31 - 1, 2**31 - 1)])
def test_a_header_that_claims_too_much_costs_nothing(width, height, tmp_path):
    (tmp_path / "huge.png").write_bytes(claiming(width, height))
    tracemalloc.start()
    with pytest.raises(FileFormatError, match=r"huge\.png"):
        read_picture(tmp_path / "huge.png")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 1e6
    with pytest.raises(FileFormatError, match="episode_0, row 3"):
        decode_picture(claiming(width, height), "episode_0, row 3")


def test_the_largest_that_is_allowed_is_read(tmp_path):
    side = int(LARGEST_PIXELS**0.5)
    Image.new("L", (side, side)).save(tmp_path / "large.png")
    assert read_picture(tmp_path / "large.png").shape == (side, side, 3)


@pytest.mark.parametrize("kind", ["eps", "gif", "bmp", "tiff", "ppm"])
def test_another_format_under_the_name_of_a_png_is_refused_and_starts_no_program(kind, tmp_path, monkeypatch):
    """Pillow hands EPS to Ghostscript."""
    monkeypatch.setattr(subprocess, "check_call", lambda *_, **__: pytest.fail("a program was started"))
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a program was started"))
    (tmp_path / "img_traj_0_step_0.png").write_bytes(encoded(kind))
    with pytest.raises(FileFormatError, match=r"img_traj_0_step_0\.png: not readable as a picture"):
        read_picture(tmp_path / "img_traj_0_step_0.png")


def test_a_chunk_that_claims_gigabytes_gets_no_room_for_them(tmp_path):
    good = bytearray(encoded("png"))
    good[33:37] = struct.pack(">I", 2**31 - 1)  # the length of IDAT
    (tmp_path / "long.png").write_bytes(good)
    tracemalloc.start()
    with contextlib.suppress(FileFormatError):  # all its rows are there: it may be read
        read_picture(tmp_path / "long.png")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 1e6


def test_a_file_larger_than_any_picture_is_not_read_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("lerobot_spacedock.dataset.sources.pictures.LARGEST_BYTES", 500)
    (tmp_path / "a.png").write_bytes(encoded("png"))
    with pytest.raises(FileFormatError, match=r"a\.png: larger than"):
        read_picture(tmp_path / "a.png")
