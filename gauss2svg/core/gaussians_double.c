/* The walk over tiles in double. */

#define IS_DOUBLE 1
#include "gaussians.h"
