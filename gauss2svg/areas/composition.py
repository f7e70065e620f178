"""Kernels that draw layers over each other, and find what shows of each of them."""

from __future__ import annotations

from gauss2svg.areas.kernels import kernel, shade_index
from gauss2svg.render.coverage import add_outline, add_stroke


@kernel
def compose(
    segment, curved, path_start, closed, layer_start, width, cap, opacity, form, place, table, box,
    offset, sums, canvas, cover, below,
):  # fmt: skip
    """Draw layers over `canvas` (h, w, c), and keep their coverage and what lies below them.

    segment, curved  (k, 4, 2) and (k,) of all paths
    path_start   (p + 1,) first segment of each path; closed (p,)
    layer_start  (l + 1,) first path of each layer; width, cap (l,)
    form, place, table  (l,), (l, 4), (l, SHADES, c) paints of the layers (shade_index). Colours of
                 transparent layers are multiplied by their opacity (l,)
    box, offset  (l, 4) left, top, width and height of a layer, and where its pixels are in `cover`
                 (m,) and `below` (m, c)
    sums         (rows, columns) buffer
    """
    channels = canvas.shape[2]
    for layer in range(len(width)):
        x0, y0, w, h = box[layer]
        part = sums[:h, : w + 2]
        for y in range(h):
            for x in range(w + 2):
                part[y, x] = 0.0
        for p in range(layer_start[layer], layer_start[layer + 1]):
            a, b = path_start[p], path_start[p + 1]
            if width[layer] > 0:
                add_stroke(
                    part, segment[a:b], curved[a:b], closed[p], width[layer], cap[layer], float(x0),
                    float(y0),
                )  # fmt: skip
            else:
                add_outline(part, segment[a:b], curved[a:b], float(x0), float(y0))
        at = offset[layer]
        for y in range(h):
            winding = 0.0
            for x in range(w):
                winding += part[y, x]
                share = min(abs(winding), 1.0)
                cover[at] = share
                for c in range(channels):
                    below[at, c] = canvas[y0 + y, x0 + x, c]
                if share > 0.0:
                    row = shade_index(form[layer], place[layer], x0 + x + 0.5, y0 + y + 0.5)
                    for c in range(channels):
                        value = canvas[y0 + y, x0 + x, c]
                        value += share * (table[layer, row, c] - opacity[layer] * value)
                        canvas[y0 + y, x0 + x, c] = value
                at += 1


@kernel
def weigh(opacity, form, place, table, box, offset, cover, below, above):
    """Turn `cover` into what shows of layers, and `below` into derivatives of pixels by coverage.

    above  (h, w) ones. Changed to the share of each pixel that no layer hides
    """
    channels = below.shape[1]
    for layer in range(len(box) - 1, -1, -1):
        x0, y0, w, h = box[layer]
        at = offset[layer]
        for y in range(y0, y0 + h):
            for x in range(x0, x0 + w):
                shows = above[y, x]
                row = shade_index(form[layer], place[layer], x + 0.5, y + 0.5)
                for c in range(channels):
                    own = table[layer, row, c]
                    below[at, c] = (own - opacity[layer] * below[at, c]) * shows
                above[y, x] = shows * (1.0 - opacity[layer] * cover[at])
                cover[at] = shows * cover[at]
                at += 1
