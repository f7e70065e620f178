"""Every photo of a folder becomes an SVG: python examples/folder.py PHOTOS OUT.

Run again, it does what is new or changed. A bad photo costs only itself.
"""

import sys

from gauss2svg import Goal, Options, vectorize_many


def main(photos: str, out: str, workers: int | None = None) -> int:
    """Exit status: 1 if a photo failed. Without a number of workers there is one for each core."""
    options = Options(goal=Goal(quality="draft", max_bytes="60k"))
    failed = 0
    for photo in vectorize_many([photos], out, options, workers=workers):
        failed += photo.error is not None
        print(photo.output, photo.error or f"{photo.psnr_svg:.1f} dB, {photo.svg_bytes} bytes")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))
