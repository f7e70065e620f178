/* What all kernels share: exported functions, small helpers of numbers, and points.

Arrays are C-contiguous, and their shapes stand in the comments as in NumPy. Python passes pointers,
int64_t and double. Sums are added up in the order in which they are written, and the compiler may
not contract them to fused multiply-adds, so that CPUs give the same bits. */

#pragma once

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
#define INLINE static inline __attribute__((always_inline))

INLINE double min(double a, double b) { return a < b ? a : b; }
INLINE double max(double a, double b) { return a > b ? a : b; }
INLINE double clip(double v, double low, double high) { return min(max(v, low), high); }
INLINE double square(double v) { return v * v; }
INLINE int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
INLINE int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }

/* A point or a vector of the plane: x and y. */
typedef double point __attribute__((vector_size(16)));

INLINE point at(double x, double y) { return (point){x, y}; }
INLINE point point_of(const double xy[2]) { return at(xy[0], xy[1]); }
INLINE double dot(point a, point b) { return a[0] * b[0] + a[1] * b[1]; }
INLINE double cross(point a, point b) { return a[0] * b[1] - a[1] * b[0]; }
INLINE double length(point a) { return sqrt(dot(a, a)); }
/* Return a vector turned by a right angle, from x to y. */
INLINE point turned(point a) { return at(-a[1], a[0]); }
