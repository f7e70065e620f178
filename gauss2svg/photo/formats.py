"""The formats of photos, one entry each, and how many pixels a picture may have.

Batches, the studio, the help and the documentation take their lists from here. This module loads
no decoder: the help needs it.
"""

from __future__ import annotations

from dataclasses import dataclass

# A quarter of a GiB at three bytes per pixel: Pillow's own limit (Image.MAX_IMAGE_PIXELS).
DEFAULT_MAX_PIXELS = 89_478_485
# Above twice that Pillow's decoders refuse any file; larger images are not rasterised either.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format that is read.

    name      Pillow's, in errors too
    title     in text
    suffixes  of names that are taken for photos where a folder is given
    plugin    module that registers the decoder with Pillow when it is imported
    feature   that a build of Pillow may lack; "": none
    prepare   MODULE:FUNCTION of a file, which returns the one that is decoded; "": the file itself
    damage    MODULE:FUNCTION of the file's bytes, the decoded image and its tags, which says what
              the file lacks that the decoder does not miss, "" if nothing; "": the decoder refuses
    """

    name: str
    suffixes: tuple[str, ...]
    plugin: str
    title: str = ""
    feature: str = ""
    prepare: str = ""
    damage: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)


FORMATS = {
    one.name: one
    for one in (
        Format(
            name="JPEG",
            suffixes=(".jpg", ".jpeg", ".jpe", ".jfif"),
            plugin="PIL.JpegImagePlugin",
            prepare="gauss2svg.photo.jpeg:with_height",
        ),
        Format(
            name="PNG",
            suffixes=(".png",),
            plugin="PIL.PngImagePlugin",
            damage="gauss2svg.photo.damage:damage_of_png",
        ),
        Format(
            name="WEBP",
            title="WebP",
            suffixes=(".webp",),
            plugin="PIL.WebPImagePlugin",
            feature="webp",
        ),
        Format(
            name="TIFF",
            suffixes=(".tif", ".tiff"),
            plugin="PIL.TiffImagePlugin",
            damage="gauss2svg.photo.damage:damage_of_tiff",
        ),
        Format(name="GIF", suffixes=(".gif",), plugin="PIL.GifImagePlugin"),
        Format(name="BMP", suffixes=(".bmp",), plugin="PIL.BmpImagePlugin"),
        Format(name="AVIF", suffixes=(".avif",), plugin="PIL.AvifImagePlugin", feature="avif"),
    )
}
SUFFIXES = tuple(suffix for one in FORMATS.values() for suffix in one.suffixes)
TITLES = tuple(one.title for one in FORMATS.values())
