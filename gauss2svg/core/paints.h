/* Paints of regions, whose colours stand in tables. */

#pragma once

#include "core.h"

enum { FLAT, LINEAR, RADIAL }; /* forms of paints */
enum { SHADES = 1024 };        /* colours of a gradient's table */

/* Return the colour (c,) of a paint at a point (x, y) in px, in its table (SHADES, c).

place  (4,) of a gradient. The position in a linear one is place[0] x + place[1] y + place[2]. That
       in a radial one is the length of (place[2] (x - place[0]), place[3] (y - place[1])) */
INLINE const float *shade(
    int64_t form, const double place[4], const float *table, int64_t c, double x, double y) {
    if (form == FLAT)
        return table;
    const double position = form == LINEAR
                                ? place[0] * x + place[1] * y + place[2]
                                : length(at(place[2] * (x - place[0]), place[3] * (y - place[1])));
    return table + (int64_t)(clip(position, 0.0, 1.0) * (SHADES - 1) + 0.5) * c;
}
