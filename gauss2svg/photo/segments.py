"""Segments of a photo, by which a document groups its shapes: superpixels or a label image."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.segmentation import slic

from gauss2svg.errors import InputError
from gauss2svg.files import reading
from gauss2svg.photo.alpha import alpha_of, has_alpha, over
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS
from gauss2svg.photo.open import loaded, opened
from gauss2svg.photo.tags import tags_of, upright

MOST_SEGMENTS = 10_000


def labels_of(
    segments: Any, size: tuple[int, int], pixels: NDArray[np.float32]
) -> NDArray[np.integer]:
    """Labels (rows, columns) of the segments, spread over the photo.

    segments  approximate number of superpixels, 1..MOST_SEGMENTS; the path of a label image,
              where each value or colour is a segment; or an array (h, w) of whole numbers >= 0
    size      width and height of the photo in px, which label images and arrays must have
    pixels    (h, w, 3) or (h, w, 4) float32 in 0..1: the photo, perhaps smaller, for superpixels
    Raises InputError for anything else, another size, and more than MOST_SEGMENTS labels.
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
            f"size of {name} must be that of the photo, {size[0]}x{size[1]} px; got "
            f"{labels.shape[1]}x{labels.shape[0]} px. Try scaling it by nearest neighbour, "
            "which adds no labels"
        )
    if not np.issubdtype(labels.dtype, np.integer):
        raise InputError(f"values of {name} must be whole numbers; got type {labels.dtype}")
    count = len(np.unique(labels))
    if count > MOST_SEGMENTS:
        raise InputError(
            f"number of labels in {name} must be at most {MOST_SEGMENTS}; got {count}. Try an "
            "image of plain areas, saved as PNG, because JPEG changes colours"
        )
    return labels


def superpixels(pixels: NDArray[np.float32], count: int) -> NDArray[np.integer]:
    """(h, w) labels 1, 2, .. of about `count` SLIC superpixels of (h, w, 3) pixels; deterministic.

    In (h, w, 4) pixels of alpha 0 have the label 0.
    """
    if not has_alpha(pixels):
        return slic(pixels, n_segments=count, start_label=1, channel_axis=2)
    visible = alpha_of(pixels)[:, :, 0] > 0
    if not visible.any():
        return np.zeros(visible.shape, np.intp)
    count = min(count, int(visible.sum()))
    return slic(over(pixels), n_segments=count, start_label=1, channel_axis=2, mask=visible)


def _read(path: str, max_pixels: int) -> NDArray[Any]:
    advice = "the path of a label image, or a number of superpixels"
    with reading(path, advice) as file, opened(file, path, max_pixels) as image:
        labels = _labels(loaded(image, path))
        return upright(labels, tags_of(image).orientation)


def _labels(image: Image.Image) -> NDArray[Any]:
    """Values of an image of one channel; of more channels the rank of each colour, from 1."""
    array = np.asarray(image)
    if array.ndim == 3:
        colors = np.zeros(array.shape[:2], np.uint32)
        for channel in np.moveaxis(array, 2, 0):
            colors = colors * 256 + channel
        ranks = np.unique(colors, return_inverse=True)[1]
        return ranks.reshape(colors.shape) + 1
    if array.dtype == bool:
        return array.astype(np.uint8)
    return array
