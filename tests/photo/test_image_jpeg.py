"""What a decoder can draw of a JPEG is read, once, with a note that names what is missing."""

import io
import struct

import numpy as np
import pytest
from gauss2svg.photo.jpeg import survey
from pictures import encoded
from PIL import Image, ImageFile

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
SMOOTH = np.uint8(np.mgrid[:240, :320].sum(0)[:, :, None] * [0.4, 0.3, 0.2] + [20, 60, 100])
PICTURE = Image.fromarray(SMOOTH + RNG.integers(0, 30, SMOOTH.shape, dtype=np.uint8))
KINDS = {
    "plain": {},
    "progressive": {"progressive": True},
    "all colours": {"subsampling": 0},
    "restarts": {"restart_marker_blocks": 7},
    "own codes": {"optimize": True, "quality": 40},
    "grey": {"mode": "L"},
    "progressive grey": {"mode": "L", "progressive": True},
    "inks": {"mode": "CMYK"},
}
END, NOTE = b"\xff\xd9", "end marker of the JPEG missing"


def jpeg_of(name: str, picture: Image.Image = PICTURE) -> bytes:
    options = dict(KINDS[name])
    return encoded(picture.convert(options.pop("mode", "RGB")), "JPEG", **options)


def plain_load(file: bytes) -> bytes:
    with Image.open(io.BytesIO(file)) as image:
        return image.tobytes()


@pytest.mark.parametrize("name", KINDS)
def test_end_marker_is_not_needed(name):
    whole = jpeg_of(name)
    expected = load_image(whole)
    for short in (whole[:-1], whole[:-2]):
        photo = load_image(short)
        np.testing.assert_array_equal(photo.pixels, expected.pixels)
        assert set(photo.notes) - set(expected.notes) == {NOTE}


@pytest.mark.parametrize("end", [b"", END])
@pytest.mark.parametrize("name", KINDS)
def test_last_bytes_of_a_scan_are_guessed_and_noted(name, end):
    whole = jpeg_of(name)
    expected = load_image(whole)
    for lost in (1, 2, 3, 6):
        photo = load_image(whole[: -2 - lost] + end)
        changed = (photo.pixels != expected.pixels).any(axis=2)
        assert changed[:-24].sum() == 0
        more = set(photo.notes) - set(expected.notes) - {NOTE}
        assert (NOTE in photo.notes) == (end == b"")
        (note,) = more
        assert note.startswith("of the JPEG data end at row 2")
        assert note.endswith(" of 240; the rest is guessed")


@pytest.mark.parametrize("name", KINDS)
def test_a_photo_that_is_cut_off_in_the_middle_is_refused(name):
    whole = jpeg_of(name)
    for left in (0.3, 0.5, 0.9, 0.97):
        for end in (b"", END):
            with pytest.raises(InputError, match=r"its data end at row|scans are missing"):
                load_image(whole[: int(left * len(whole))].rstrip(b"\xff") + end)


@pytest.mark.parametrize("name", KINDS)
def test_height_may_follow_the_first_scan(name):
    whole = jpeg_of(name)
    expected = load_image(whole)
    place = whole.index(b"\xff\xc2" if "progressive" in name else b"\xff\xc0") + 5
    end = whole.index(b"\xff\xda")
    end = next(
        k for k in range(end + 2, len(whole) - 1)
        if whole[k] == 255 and whole[k + 1] != 0 and not 0xD0 <= whole[k + 1] < 0xD8
    )  # fmt: skip
    lines = b"\xff\xdc" + struct.pack(">HH", 4, 240)
    file = whole[:place] + b"\0\0" + whole[place + 2 : end] + lines + whole[end:]
    photo = load_image(file)
    np.testing.assert_array_equal(photo.pixels, expected.pixels)
    (note,) = set(photo.notes) - set(expected.notes)
    assert note == "height read from the end of the JPEG's first scan"
    with pytest.raises(InputError, match="its header has no size"):
        load_image(whole[:place] + b"\0\0" + whole[place + 2 :])
    with pytest.raises(InputError, match="at most 76799 px"):
        load_image(file, max_pixels=76799)


def test_codes_of_the_standard_need_not_be_in_the_file():
    whole = file = jpeg_of("plain")
    while (place := file.find(b"\xff\xc4")) >= 0:
        file = file[:place] + file[place + 2 + int.from_bytes(file[place + 2 : place + 4]) :]
    assert len(file) < len(whole) - 400
    photo = load_image(file)
    np.testing.assert_array_equal(photo.pixels, load_image(whole).pixels)
    assert photo.notes == ()


@pytest.mark.parametrize("name", KINDS)
def test_a_jpeg_is_decoded_once(name, monkeypatch):
    calls = []
    decoder = Image._getdecoder
    monkeypatch.setattr(
        ImageFile.Image, "_getdecoder", lambda *args, **more: calls.append(args) or decoder(*args)
    )
    for file in (whole := jpeg_of(name), whole[:-2]):
        calls.clear()
        load_image(file)
        assert len(calls) == 1


@pytest.mark.parametrize("name", KINDS)
def test_data_lack_something_where_what_follows_them_changes_the_picture(name):
    whole = jpeg_of(name, PICTURE.crop((0, 0, 40, 24)))
    begin = whole.rindex(b"\xff\xda")
    begin += 2 + int.from_bytes(whole[begin + 2 : begin + 4])
    for end in range(begin, len(whole) - 1):
        short = whole[:end].rstrip(b"\xff")
        drawn = {
            plain_load(short + padding * 99 + END) for padding in (b"\x15", b"\xea", b"\x33", b"\0")
        }
        assert bool(survey(short + END, (40, 24)).missing) == (len(drawn) > 1), len(whole) - end
