/* Pairs of Gaussians and tiles (gauss2svg.render.cpu), and connected components. */

#include "core.h"

enum { TILE = 16, ROW_BITS = 4 }; /* px of a side of a tile, and its logarithm */
/* Each pair of a shape whose width sy sqrt(1 - rho^2) along a column is less than this number of px
has only one row, because rounding would make steps from one row to the next too inexact. */
static const double LEAST_STEPPED = 1.0 / 64;

/* Count the pairs of n Gaussians and the tiles of an image, or list them if `gaussian` is not NULL.

height, width  of the image in px
shape      (n, 6) mean x, y, sigma x, y in px, rho, and the radius of the cut in sigmas
offset, tile_rows  as find_pairs returns them: output if the pairs are counted, 0 on entry
end        (tiles,) output: number of pairs of each tile, 0 on entry. If the pairs are listed, it has
           the end of the part of `order` for each tile on entry, and its start afterwards
gaussian, rows, order  as find_pairs returns them: output if the pairs are listed

A strip is the part of a Gaussian in one column of tiles. At the horizontal offset u from the mean,
the rim of the ellipse has the vertical offsets
v = sy (rho u / sx +- k sqrt(radius^2 - u^2 / sx^2)) with k = sqrt(1 - rho^2). The part of the rim
with + is concave, and has its largest v = sy radius at u = rho sx radius. The part with - is its
point reflection. */
API void list_pairs(int64_t n, int64_t height, int64_t width, const double (*shape)[6],
    int64_t *offset, int64_t *tile_rows, int64_t *end, int32_t *gaussian, int32_t (*rows)[2],
    int32_t *order) {
    const int64_t columns = (width + TILE - 1) / TILE;
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        const double x = shape[i][0], y = shape[i][1], sx = shape[i][2], sy = shape[i][3];
        const double rho = shape[i][4], radius = shape[i][5], reach = sx * radius;
        const double k = sy * sqrt((1.0 - rho) * (1.0 + rho)), slope = rho * sy / sx;
        const int64_t bits = k < LEAST_STEPPED ? 0 : ROW_BITS;
        /* Clip before each conversion, because the Gaussian may reach far off the image. */
        int64_t column = (int64_t)clip(x - reach, 0.0, (double)width) / TILE;
        const int64_t last = (int64_t)clip(x + reach, 0.0, (double)width - 1.0) / TILE;
        if (!(x + reach >= 0.0 && x - reach <= (double)width))
            column = last + 1;
        for (; column <= last; column++) {
            const int64_t x0 = column * TILE;
            const double u0 = max((double)x0 + 0.5 - x, -reach);
            const double u1 = min((double)least(x0 + TILE, width) - 0.5 - x, reach);
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
            /* The centre of row r lies at r + 0.5. */
            const int64_t bottom =
                (int64_t)floor(clip(y + high - 0.5, -1.0, (double)height - 1.0)) + 1;
            int64_t row = (int64_t)ceil(clip(y + low - 0.5, 0.0, (double)height)), next;
            for (; row < bottom; row = next, count++) {
                next = least(bottom, ((row >> bits) + 1) << bits);
                const int64_t tile = (row >> ROW_BITS) * columns + column;
                if (gaussian == NULL) {
                    end[tile]++;
                    tile_rows[tile] += next - row;
                    continue;
                }
                gaussian[count] = (int32_t)i;
                rows[count][0] = (int32_t)row;
                rows[count][1] = (int32_t)next;
                /* Pairs come from the bottom Gaussian to the topmost one, but the list of a tile
                runs from front to back. So each list is filled from its end. */
                order[--end[tile]] = (int32_t)count;
            }
        }
        offset[i + 1] = count;
    }
}

/* Number the components of a picture of levels (h, w): pixels of one level that touch along sides
or at corners. Numbers (h, w) begin at 1, in the order of first pixels. Those of level 0 are 0.

stack  (h, w) buffer for the pixels of a component whose neighbours are to be looked at */
API void number_components(
    int64_t height, int64_t width, const int32_t *levels, int64_t *stack, int64_t *numbers) {
    int64_t count = 0;
    memset(numbers, 0, (size_t)(height * width) * sizeof *numbers);
    for (int64_t first = 0; first < height * width; first++) {
        int64_t held = 0;
        if (levels[first] != 0 && numbers[first] == 0) {
            numbers[first] = ++count;
            stack[held++] = first;
        }
        while (held > 0) {
            const int64_t pixel = stack[--held], y = pixel / width, x = pixel % width;
            for (int64_t v = most(0, y - 1); v < least(height, y + 2); v++) {
                for (int64_t u = most(0, x - 1); u < least(width, x + 2); u++) {
                    const int64_t other = v * width + u;
                    if (levels[other] != levels[pixel] || numbers[other] != 0)
                        continue;
                    numbers[other] = count;
                    stack[held++] = other;
                }
            }
        }
    }
}
