/* What every kernel that computes asks of a compiler: the bits of numpy. */

#ifndef CALIBKIT_DOUBLES_H
#define CALIBKIT_DOUBLES_H

#include <float.h>

#if FLT_EVAL_METHOD != 0
#error "doubles are not rounded at every operation here: these kernels would not have the bits of numpy"
#endif

/* Whether a second copy for wider registers can be made and chosen at run time. */
#if defined(__GNUC__) && defined(__x86_64__)
#define WIDE 1
#else
#define WIDE 0
#endif

#endif
