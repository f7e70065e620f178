/* Pairs of Gaussians and tiles (gauss2svg.render.tiles), and connected components. */

#include "core.h"

/* Write for each strip the image rows in which a Gaussian reaches centres of pixels. A strip is the
part of one Gaussian that lies in one column of tiles.

first..end  the Gaussians
height, width, tile  sizes of the image and width of a tile in px
shape       (n, 6) mean x, y, sigma x, y in px, rho, and the radius of the cut in sigmas
column      (n,) first tile column of each Gaussian
strip       (n + 1,) Gaussian i has the strips strip[i]:strip[i + 1]
strip_rows  (s, 2) output: first row of each strip, and the row after its last one. They are equal
            if the Gaussian reaches no row

At the horizontal offset u from the mean, the rim of the ellipse has the vertical offsets
v = sy (rho u / sx +- k sqrt(radius^2 - u^2 / sx^2)) with k = sqrt(1 - rho^2). The part of the rim
with + is concave, and has its largest v = sy radius at u = rho sx radius. The part with - is its
point reflection. */
API void find_strip_rows(int64_t first, int64_t end, double height, double width, int64_t tile,
    const double (*shape)[6], const int64_t *column, const int64_t *strip,
    int64_t (*strip_rows)[2]) {
    for (int64_t i = first; i < end; i++) {
        const double x = shape[i][0], y = shape[i][1], sx = shape[i][2], sy = shape[i][3];
        const double rho = shape[i][4], radius = shape[i][5], reach = sx * radius;
        const double k = sy * sqrt((1.0 - rho) * (1.0 + rho)), slope = rho * sy / sx;
        for (int64_t s = strip[i]; s < strip[i + 1]; s++) {
            const int64_t x0 = (column[i] + s - strip[i]) * tile;
            const double u0 = max((double)x0 + 0.5 - x, -reach);
            const double u1 = min(min((double)(x0 + tile), width) - 0.5 - x, reach);
            strip_rows[s][0] = strip_rows[s][1] = 0;
            if (!(u0 <= u1))
                continue;
            const double half0 = k * sqrt(max(radius * radius - square(u0 / sx), 0.0));
            const double half1 = k * sqrt(max(radius * radius - square(u1 / sx), 0.0));
            double high = max(slope * u0 + half0, slope * u1 + half1);
            double low = min(slope * u0 - half0, slope * u1 - half1);
            if (u0 <= rho * reach && rho * reach <= u1)
                high = sy * radius;
            if (u0 <= -rho * reach && -rho * reach <= u1)
                low = -sy * radius;
            /* The centre of row r lies at r + 0.5. Clip before the conversion, because the Gaussian
            may reach far off the image. */
            strip_rows[s][0] = (int64_t)ceil(clip(y + low - 0.5, 0.0, height));
            strip_rows[s][1] = (int64_t)floor(clip(y + high - 0.5, -1.0, height - 1.0)) + 1;
        }
    }
}

/* Cut strips into pairs, and list the pairs of each tile by a counting sort.

columns, tiles  number of tile columns, and of tiles
row_bits   a tile has 2^row_bits rows
bits       (n,) a pair of Gaussian i has at most 2^bits[i] rows
column, strip, strip_rows  as in find_strip_rows
offset, gaussian, rows, start, order  as find_pairs returns them: output. offset and start must be 0 on entry
tile       (p,) output: the tile of each pair
tile_rows  (tiles,) output: number of pair rows in each tile. It must be 0 on entry */
API void list_pairs(int64_t n, int64_t columns, int64_t tiles, int64_t row_bits,
    const int64_t *bits, const int64_t *column, const int64_t *strip,
    const int64_t (*strip_rows)[2], int64_t *offset, int32_t *gaussian, int32_t *tile,
    int32_t (*rows)[2], int64_t *start, int64_t *tile_rows, int32_t *order) {
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        for (int64_t s = strip[i]; s < strip[i + 1]; s++) {
            for (int64_t y = strip_rows[s][0], end; y < strip_rows[s][1]; y = end, count++) {
                end = least(strip_rows[s][1], ((y >> bits[i]) + 1) << bits[i]);
                const int64_t t = (y >> row_bits) * columns + column[i] + s - strip[i];
                gaussian[count] = (int32_t)i;
                tile[count] = (int32_t)t;
                rows[count][0] = (int32_t)y;
                rows[count][1] = (int32_t)end;
                start[t + 1]++;
                tile_rows[t] += end - y;
            }
        }
        offset[i + 1] = count;
    }
    for (int64_t t = 0; t < tiles; t++)
        start[t + 1] += start[t];
    /* Pairs come from the bottom Gaussian to the topmost one, but the list of a tile runs from
    front to back. So each list is filled from its end, and start[t + 1] is its last element
    written. In the end that is where list t begins, which is moved to start[t]. */
    for (int64_t p = 0; p < count; p++)
        order[--start[tile[p] + 1]] = (int32_t)p;
    memmove(start, start + 1, (size_t)tiles * sizeof *start);
    start[tiles] = count;
}

/* Return the root of a pixel in a forest, in which the parent of a root is the root itself. Halve
the path to it. */
INLINE int64_t root_of(int64_t *parent, int64_t pixel) {
    while (parent[pixel] != pixel)
        pixel = parent[pixel] = parent[parent[pixel]];
    return pixel;
}

/* Number the components of a picture of levels (h, w): pixels of one level that touch along sides
or at corners. Numbers (h, w) begin at 1, in the order of first pixels. Those of level 0 are 0.

parent  (h, w) buffer for a forest, in which the root of a component is its first pixel */
API void number_components(
    int64_t height, int64_t width, const int32_t *levels, int64_t *parent, int64_t *numbers) {
    int64_t count = 0;
    for (int64_t pixel = 0; pixel < height * width; pixel++) {
        const int64_t y = pixel / width, x = pixel % width;
        parent[pixel] = pixel;
        for (int k = 0; k < 4 && levels[pixel] != 0; k++) { /* left, and the three above */
            const int64_t v = k == 0 ? y : y - 1, u = k == 0 ? x - 1 : x + k - 2;
            if (v < 0 || u < 0 || u >= width || levels[v * width + u] != levels[pixel])
                continue;
            const int64_t other = root_of(parent, v * width + u), own = root_of(parent, pixel);
            parent[most(own, other)] = least(own, other);
        }
    }
    for (int64_t pixel = 0; pixel < height * width; pixel++) {
        const int64_t root = root_of(parent, pixel);
        numbers[pixel] = levels[pixel] == 0 ? 0 : root == pixel ? ++count : numbers[root];
    }
}
