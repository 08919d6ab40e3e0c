/* Numbers of the kernel contract that both sides must agree on: inputs (InputSlot of compiler/ir/ir.h) and kinds of
 * kernels (KernelKind of compiler/pass/pass.h). The runtime may not include the compiler, so they are written down
 * again here. */
#ifndef SALTUS_SAMPLE_SLOTS_H
#define SALTUS_SAMPLE_SLOTS_H

enum {
    SLT_IN_X0,
    SLT_IN_X1,
    SLT_IN_X2,
    SLT_IN_STREAM,
    SLT_IN_RAND0,
    SLT_IN_PIXEL0,
    SLT_IN_PIXEL1,
    SLT_IN_SAMPLE,
    SLT_IN_SEED0,
    SLT_IN_SEED1,
    SLT_IN_SEED2,
    SLT_IN_SEED3,
    SLT_IN_K0,
    SLT_IN_K7 = SLT_IN_K0 + 7,
    SLT_IN_AUX,
    SLT_IN_DX0,
    SLT_IN_DX1,
    SLT_IN_DX2,
    SLT_IN_AUX1,
    SLT_IN_COUNT
};

typedef enum SltKernelKind {
    SLT_K_VALUE,
    SLT_K_REGION,
    SLT_K_EVENT,
    SLT_K_SIDES,
    SLT_K_SITE,
    SLT_K_SITE_GRAD,
    SLT_K_SITE_JVP,
    SLT_K_SITE_VJP,
    SLT_K_JVP,
    SLT_K_VJP,
    SLT_K_CULL
} SltKernelKind;

enum { SLT_MAX_K = 8, SLT_MAX_CHANNELS = 4, SLT_WITNESSES = 2 };

#endif
