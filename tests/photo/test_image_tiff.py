"""TIFFs of many kinds are the pictures that were stored; those that are not read say why."""

import numpy as np
import pytest
from pictures import assert_read, tiff

NAIVE = (
    "CMYK without a usable ICC profile; converted by the naive formula, whose colours may be too "
    "vivid"
)
VALUES = np.random.default_rng(0).uniform(0.2, 1, (37, 45, 4))
KINDS = {  # photometric, channels, extra sample
    "colours": ("rgb", 3, None),
    "straight alpha": ("rgb", 4, "unassalpha"),
    "premultiplied alpha": ("rgb", 4, "assocalpha"),
    "unknown fourth": ("rgb", 4, "unspecified"),
    "grey": ("minisblack", 1, None),
    "inverted grey": ("miniswhite", 1, None),
    "grey and alpha": ("minisblack", 2, "unassalpha"),
    "inks": ("separated", 4, None),
}
TYPES = {"8": np.uint8, "16": np.uint16, "float": np.float32}
LAYOUTS = {
    "one strip": {},
    "strips": {"rowsperstrip": 8},
    "tiles": {"tile": (16, 32)},
    "planes": {"planarconfig": "separate", "rowsperstrip": 8},
}
# One channel has no planes, and planes of grey with alpha are refused.
STORED = [(kind, way) for kind in KINDS for way in LAYOUTS if way != "planes" or KINDS[kind][1] > 2]


@pytest.mark.parametrize("type_name", TYPES)
@pytest.mark.parametrize(("kind", "layout"), STORED)
def test_samples_are_those_that_were_stored(kind, type_name, layout):
    photometric, channels, extra = KINDS[kind]
    values = VALUES[:, :, :channels]
    stored = np.dstack([values[:, :, :-1] * values[:, :, -1:], values[:, :, -1:]])
    stored = stored if extra == "assocalpha" else values
    if (kind, type_name) == ("inverted grey", "float"):
        return  # which is not inverted
    top = 1 if type_name == "float" else np.iinfo(TYPES[type_name]).max
    samples = (stored * top).round() if top > 1 else stored
    samples, options = samples.astype(TYPES[type_name]), dict(LAYOUTS[layout])
    if layout == "planes":
        samples = np.ascontiguousarray(np.moveaxis(samples, -1, 0))
    elif channels > 1:
        options["planarconfig"] = "contig"
    options |= {"extrasamples": [extra]} if extra else {}
    color = values[:, :, :-1] if extra else values
    color = 1 - color if photometric == "miniswhite" else color
    if photometric == "separated":
        color = (1 - values[:, :, :3]) * (1 - values[:, :, 3:])
    # Dividing by an alpha of at least 0.2 enlarges the error of both.
    levels = 255 if type_name == "8" else 65535
    for order, compression in ((">", None), ("<", "zlib")):
        options |= {"byteorder": order, "compression": compression}
        file = tiff(samples.squeeze(), photometric=photometric, **options)
        alpha = None if extra in (None, "unspecified") else values[:, :, -1]
        notes = (NAIVE,) if photometric == "separated" else ()
        assert_read(file, color, notes, 6 / levels, alpha)


def test_cielab_is_read_as_the_colours_that_it_names():
    """White, the red of sRGB, and a middle grey, by the white point D50."""
    lab = np.int8([[[-1, 0, 0], [-118, 81, 70], [-119, 0, 0]]]).view(np.uint8)
    color = np.array([[[1, 1, 1], [1, 0, 0], [0.5, 0.5, 0.5]]])
    for order in "<>":
        assert_read(tiff(lab, photometric="cielab", byteorder=order), color, (), 6 / 255)
