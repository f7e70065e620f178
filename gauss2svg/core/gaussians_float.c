/* The walk over tiles in float. */

#define IS_DOUBLE 0
#include "gaussians.h"
