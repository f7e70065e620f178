"""Make a gallery of the photos that scikit-image ships, and print its medians.

python benchmarks/gallery.py site                        # 21 photos, 384 px, 1404 Gaussians
python benchmarks/gallery.py site coffee astronaut chelsea --peers splatthis:default
python benchmarks/gallery.py sample --sample             # two photos

Size and count are those of SplatThis' own gallery, whose medians are printed for comparison. The
photos are the same except for clock_motion, which replaces one that scikit-image does not have.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import skimage.data
from common import command_line
from tracers import draw

from gauss2svg import GalleryOptions, build_gallery

FILES = (
    "astronaut.png", "brick.png", "camera.png", "cell.png", "chelsea.png", "chessboard_GRAY.png",
    "clock_motion.png", "coffee.png", "coins.png", "color.png", "grass.png", "gravel.png",
    "hubble_deep_field.jpg", "ihc.png", "logo.png", "moon.png", "motorcycle_left.png", "page.png",
    "retina.jpg", "rocket.jpg", "text.png",
)  # fmt: skip
# https://github.com/BramAlkema/SplatThis, version 0.3, on the machine of its authors.
PUBLISHED = {"psnr_svg": 25.6, "ssim_svg": 0.780, "svg_bytes": 1.25e6, "total_s": 401.0}


def main() -> int:
    """Make the gallery of the command line; returns 1 if something failed."""
    parser = command_line(__doc__)
    parser.add_argument("directory", type=Path)
    parser.add_argument("photos", nargs="*", help="names without an ending, such as coffee")
    parser.add_argument("--peers", nargs="*", default=[], help="styles of benchmarks/tracers.py")
    parser.add_argument("--sample", action="store_true")
    args = parser.parse_args()
    names = [name for name in FILES if not args.photos or name.partition(".")[0] in args.photos]
    counts, options = (1404,), GalleryOptions(photo_size=384)
    if args.sample:
        names, counts = ["coffee.png", "chelsea.png"], (100, 800)
        options = GalleryOptions(photo_size=256, title="Two photos as Gaussians")
    # The package's own folder: skimage.data_dir is a download cache where pooch is installed.
    shipped = Path(skimage.data.__file__).parent
    photos, drawings = [str(shipped / name) for name in names], Path(f"{args.directory}-tracers")
    folders = [draw(style, photos, drawings, 4000.0, 384) for style in args.peers]
    gallery = build_gallery(
        photos,
        args.directory,
        counts=counts,
        peers=[f"{folder.name}={folder}" for folder in folders],
        options=options,
        command=" ".join(["python", "benchmarks/gallery.py", *sys.argv[1:]]),
        progress=True,
    )
    print_medians(gallery["summary"])
    for failure in gallery["failures"]:
        print(f"{failure['photo']}: {failure['error']}")
    print(f"open {args.directory}/index.html")
    return 1 if gallery["failures"] else 0


def print_medians(summary: list[dict[str, Any]]) -> None:
    """Return the medians of each variant over the photos, and those that SplatThis publishes."""
    print(f"{'median':16} photos  PSNR dB   SSIM  bytes      s")
    rows = [
        (row["variant"], row["photos"], {name: row[f"median_{name}"] for name in PUBLISHED})
        for row in summary
    ]
    for name, count, medians in [*rows, ("published", len(FILES), PUBLISHED)]:
        print(
            f"{name:16} {count:6}  {medians['psnr_svg']:7.2f}  {medians['ssim_svg']:.3f}"
            f"  {medians['svg_bytes'] / 1e3:5.0f}k  {medians['total_s']:5.1f}"
        )


if __name__ == "__main__":
    sys.exit(main())
