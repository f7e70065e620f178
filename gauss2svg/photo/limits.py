"""How many pixels a picture may have; without Pillow, for the help of the command line."""

# A quarter of a GiB at three bytes per pixel: Pillow's own limit (Image.MAX_IMAGE_PIXELS).
DEFAULT_MAX_PIXELS = 89_478_485
# Above twice that Pillow's decoders refuse any file; larger images are not rasterised either.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS
