"""Kernels that draw layers over each other, and move their outlines by steps of Gauss-Newton.

The parameters are the coordinates of all points, x and y in turns, and then the widths of layers.

A sample is a piece of an outline in one pixel. It has nine derivatives: by the coordinates of the
four control points of its segment, and by the width of its layer.
"""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.areas.kernels import kernel, shade_index
from gauss2svg.render.coverage import add_outline, add_stroke, point_at

ACROSS = 6  # places along the end of a stroke at which it is sampled


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


@kernel
def list_samples(
    segment, curved, count, is_first, is_last, layer_of, sign, width, box, offset, weight, columns,
    pixel, owner, jacobian, weights,
):  # fmt: skip
    """List what a move of outlines changes, one sample for each pixel that a segment runs through.

    count    (k,) number of places along each segment (4, 2) at which it is sampled
    is_first, is_last  (k,) whether a segment begins or ends an open path
    layer_of  (k,) layer of each segment
    sign     (l,) 1 or -1 for the side of its outlines on which a layer lies
    box, offset, weight  (l, 4), (l,) and (m, c) of the layers, as `weigh` writes them
    pixel, owner  (n,) outputs: pixel y * columns + x, and segment
    jacobian (n, 9) output: derivatives of the pixel's coverage
    weights  (n, c) output: derivative of the pixel by its coverage
    Return the number of samples.
    """
    n = 0
    for s in range(len(segment)):
        layer = layer_of[s]
        left, top, across, down = box[layer]
        is_stroke = width[layer] > 0.0
        # An area has one side. A stroke has two sides and, if it is open, two ends.
        for side in range(4 if is_stroke else 1):
            if (side == 2 and not is_first[s]) or (side == 3 and not is_last[s]):
                continue
            steps = ACROSS if side >= 2 else count[s]
            before = -1
            for i in range(steps):
                place = (i + 0.5) / steps
                t = place if side < 2 else side - 2.0
                x, y, along_x, along_y = point_at(segment[s], curved[s], t)
                speed = math.hypot(along_x, along_y) + 1e-12
                wider = 0.0
                if side < 2:
                    e = (1.0 - 2.0 * side if is_stroke else sign[layer]) / steps
                    beside = e * steps * 0.5 * width[layer]
                    nx, ny = e * along_y, -e * along_x
                    if is_stroke:
                        wider = 0.5 * speed / steps
                else:
                    e = (2.0 * side - 5.0) * width[layer] / steps / speed
                    beside = (place - 0.5) * width[layer]
                    nx, ny = e * along_x, e * along_y
                u = math.floor(x + beside * along_y / speed)
                v = math.floor(y - beside * along_x / speed)
                if not (left <= u < left + across and top <= v < top + down):
                    before = -1
                    continue
                if v * columns + u != before:
                    before = v * columns + u
                    pixel[n], owner[n] = before, s
                    for k in range(9):
                        jacobian[n, k] = 0.0
                    for c in range(weight.shape[1]):
                        weights[n, c] = weight[offset[layer] + (v - top) * across + u - left, c]
                    n += 1
                w = 1.0 - t
                if curved[s]:
                    b0, b1, b2, b3 = w * w * w, 3 * w * w * t, 3 * w * t * t, t * t * t
                else:
                    b0, b1, b2, b3 = w, 0.0, 0.0, t
                for k, b in enumerate((b0, b1, b2, b3)):
                    jacobian[n - 1, 2 * k] += b * nx
                    jacobian[n - 1, 2 * k + 1] += b * ny
                jacobian[n - 1, 8] += wider
    return n


@kernel
def gradient(place, owner, jacobian, weights, column, ties, image, result):
    """Write the gradient (u,) by all parameters of a gradient by pixels, image (m, c).

    place   (n,) row of each sample's pixel in `image`
    column  (k, 9) parameters by which the derivatives of a segment's samples are
    ties    parameter, node, master (t,) and their two factors (t,): a parameter is the sum of the
            node and the master, times these. The gradient by it becomes a part of theirs
    """
    result[:] = 0.0
    for r in range(len(place)):
        g = 0.0
        for c in range(weights.shape[1]):
            g += image[place[r], c] * weights[r, c]
        for k in range(9):
            result[column[owner[r], k]] += g * jacobian[r, k]
    parameter, node, master, of_node, of_master = ties
    for i in range(len(parameter)):
        g = result[parameter[i]]
        result[parameter[i]] = 0.0
        result[node[i]] += of_node[i] * g
        result[master[i]] += of_master[i] * g


@kernel
def solve(place, owner, jacobian, weights, column, ties, image, r, diagonal, damping, steps):
    """Solve (J'J + D) step = r by conjugate gradients, preconditioned by the diagonal.

    image     (m, c) buffer
    r         (u,) right side, which is changed
    diagonal  (u,) of J'J + D, all of it positive
    damping   (u,) D
    Return the step (u,). Parameters that follow from others have the step 0.
    """
    parameter, node, master, of_node, of_master = ties
    step, product, p = np.zeros(len(r)), np.empty(len(r)), r / diagonal
    rz = first = (r * p).sum()
    for _ in range(steps):
        # So no division is by 0: D is positive, and p is not 0 if rz is not.
        if rz < 1e-8 * first or rz < 1e-18:
            break
        full = p.copy()
        for i in range(len(parameter)):
            full[parameter[i]] = of_node[i] * p[node[i]] + of_master[i] * p[master[i]]
        image[:] = 0.0
        for n in range(len(place)):
            move = 0.0
            for k in range(9):
                move += jacobian[n, k] * full[column[owner[n], k]]
            for c in range(image.shape[1]):
                image[place[n], c] += move * weights[n, c]
        gradient(place, owner, jacobian, weights, column, ties, image, product)
        product += damping * p
        length = rz / (p * product).sum()
        step += length * p
        r -= length * product
        new = (r * r / diagonal).sum()
        p = r / diagonal + new / rz * p
        rz = new
    return step
