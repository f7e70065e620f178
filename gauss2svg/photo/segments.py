"""Segments of a photo, by which a document groups its shapes: superpixels, or a label image."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.segmentation import slic

from gauss2svg.errors import InputError
from gauss2svg.photo.alpha import alpha_of, has_alpha, over
from gauss2svg.photo.files import DEFAULT_MAX_PIXELS, loaded, opened, reading
from gauss2svg.photo.tags import orientation_left, upright

MOST_SEGMENTS = 10_000
_SEVERAL_CHANNELS = 3  # dimensions of an array of colours


def labels_of(
    segments: Any, size: tuple[int, int], pixels: NDArray[np.float32]
) -> NDArray[np.integer]:
    """Labels (rows, columns), spread over the photo, of the segments that were asked for.

    segments  about how many superpixels, 1..MOST_SEGMENTS; the path of a label image, each
              value or colour a segment; or an array (h, w) of whole numbers >= 0
    size      width and height of the photo in px, which the last two must have
    pixels    (h, w, 3) or (h, w, 4) float32 in 0..1: the photo, perhaps smaller, for superpixels
    Raises InputError for what is none of these, of another size, or has more segments.
    """
    if isinstance(segments, (str, os.PathLike)):
        name = os.fsdecode(segments)
        labels = _read(name, max(size[0] * size[1], DEFAULT_MAX_PIXELS))
    elif isinstance(segments, np.ndarray):
        name, labels = "segments", segments
    else:
        return superpixels(pixels, segments)
    if labels.ndim == 2 and labels.shape[::-1] != size:
        raise InputError(
            f"{name} has {labels.shape[1]}x{labels.shape[0]} px and the photo {size[0]}x{size[1]}; "
            "needed is the same size: scale it by nearest neighbour, so that no label is new"
        )
    if not np.issubdtype(labels.dtype, np.integer):
        raise InputError(f"{name} has values of type {labels.dtype}; needed are whole numbers")
    count = len(np.unique(labels))
    if count > MOST_SEGMENTS:
        raise InputError(
            f"{name} has {count} different labels; needed are at most {MOST_SEGMENTS}: make it of "
            "plain areas, and keep it as PNG, for JPEG changes colours"
        )
    return labels


def superpixels(pixels: NDArray[np.float32], count: int) -> NDArray[np.integer]:
    """(h, w) labels 1, 2, .. of about `count` superpixels of (h, w, 3) pixels; always the same.

    Of (h, w, 4) what shows is divided, 0 is what does not.
    """
    if not has_alpha(pixels):
        return slic(pixels, n_segments=count, start_label=1, channel_axis=2)
    shown = alpha_of(pixels)[:, :, 0] > 0
    if not shown.any():
        return np.zeros(shown.shape, np.intp)
    count = min(count, int(shown.sum()))
    return slic(over(pixels), n_segments=count, start_label=1, channel_axis=2, mask=shown)


def _read(path: str, max_pixels: int) -> NDArray[Any]:
    needed = "give the path of a label image, or how many segments there shall be"
    with reading(path, needed) as file, opened(file, path, max_pixels) as picture:
        labels = _labels(loaded(picture, path))
        return upright(labels, orientation_left(picture))


def _labels(picture: Image.Image) -> NDArray[Any]:
    """Values of a picture of one channel; of more the rank of each colour, from 1."""
    array = np.asarray(picture)
    if array.ndim == _SEVERAL_CHANNELS:
        colors = np.zeros(array.shape[:2], np.uint32)
        for channel in np.moveaxis(array, 2, 0):
            colors = colors * 256 + channel
        ranks = np.unique(colors, return_inverse=True)[1]
        return ranks.reshape(colors.shape) + 1
    if array.dtype == bool:
        return array.astype(np.uint8)
    return array
