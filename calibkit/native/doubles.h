/* What every kernel that computes asks of a compiler: the bits of numpy. */

#ifndef CALIBKIT_DOUBLES_H
#define CALIBKIT_DOUBLES_H

#include <float.h>

#if FLT_EVAL_METHOD != 0
#error "doubles are not rounded at every operation here: these kernels would not have the bits of numpy"
#endif

#endif
