#include "../ispc.h"
#include "kernels.c"
