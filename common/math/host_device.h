#pragma once

/// Marks what CPU and CUDA compile alike. On the CPU it is always inlined, so that a kernel compiled for one
/// instruction set never shares a copy of a helper with another. The only macro of its kind; kernels name no
/// other.
#ifdef __CUDACC__
#define QUARRY_HOST_DEVICE __host__ __device__
#else
#define QUARRY_HOST_DEVICE [[gnu::always_inline]]
#endif
