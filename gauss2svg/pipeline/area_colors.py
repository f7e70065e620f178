"""Colours of areas, solved again together with the Gaussians that are drawn above them.

A picture is a linear function of these colours: each pixel is g + sum_k w_k c_k. c_k is a flat
colour or that of a stop of a gradient. w_k is its share of the pixel, times what shows through all
that is above. g is the light of the Gaussians.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.colors import solved_colors
from gauss2svg.photo.pixels import BACKDROPS, views
from gauss2svg.render.areas import coverage_of
from gauss2svg.render.cpu import render_planar, splats_of
from gauss2svg.scene import Scene

PRIOR = 0.3  # px of its former colour that count for each colour. So hidden colours stay


def with_solved_colors(scene: Scene, picture: NDArray[np.float32]) -> Scene:
    """Return the scene with colours of areas and background that draw a picture best.

    All of these colours are rounded to 8 bits.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    from scipy.sparse import csr_array, vstack  # few runs need it

    height, width = picture.shape[:2]
    scale = width / scene.width, height / scene.height
    across, down = (np.arange(n) + 0.5 for n in (width, height))
    across, down = across / scale[0], down[:, None] / scale[1]
    splats = splats_of(scene, scale)._replace(background=np.zeros(3))
    light = render_planar(splats, height, width).reshape(3, -1).T
    alone = splats._replace(
        background=np.ones(3), opacity_color=splats.opacity_color * [1, 0, 0, 0]
    )
    through = render_planar(alone, height, width)[0].astype(np.float64)
    weights, colors = [], []  # from the top colour to the bottom one
    for area in reversed(scene.areas):
        alpha, paint = area.opacity * coverage_of(area, 0, 0, width, height, scale), area.paint
        stops, shares = [paint], [alpha * through]
        if not isinstance(paint, tuple):
            stops, ramps = paint.colors, np.eye(len(paint.colors))
            ramps = (np.repeat(ramp[:, None], 3, axis=1) for ramp in ramps)
            hats = [dataclasses.replace(paint, colors=ramp).at(across, down) for ramp in ramps]
            shares = [shares[0] * hat[..., 0] for hat in hats]
        weights += [csr_array(share.reshape(1, -1)) for share in reversed(shares)]
        colors += reversed(stops)
        through *= 1 - alpha
    through = through.reshape(-1, 1)
    if not scene.transparent:
        weights.append(csr_array(through.T))
        colors.append(tuple(scene.background))
    rows, shown = vstack(weights).tocsr(), views(picture)
    missing = [view.reshape(-1, 3) - light for view in shown]
    if scene.transparent:
        missing = [m - b * through for m, b in zip(missing, BACKDROPS, strict=True)]
    products = len(shown) * (rows @ rows.T).toarray() + PRIOR * np.eye(len(colors))
    sums = rows @ np.sum(missing, axis=0) + PRIOR * np.array(colors)
    solved = list(map(tuple, solved_colors(products, sums, 255).tolist()))
    background = scene.background if scene.transparent else solved.pop()
    areas = []
    for area in scene.areas:
        if isinstance(area.paint, tuple):
            paint = solved.pop()
        else:
            paint = dataclasses.replace(
                area.paint, colors=tuple(solved.pop() for _ in area.paint.colors)
            )
        areas.append(dataclasses.replace(area, paint=paint))
    return scene.replace(areas=areas, background=background)
