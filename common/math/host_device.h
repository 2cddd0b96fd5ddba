#pragma once

/// Marks a function that both the CPU compiler and the CUDA compiler build. On the CPU the function is always
/// inlined, so that kernels compiled for different instruction sets never share a copy of it. Kernels use no
/// other macro of this kind.
#ifdef __CUDACC__
#define QUARRY_HOST_DEVICE __host__ __device__
#else
#define QUARRY_HOST_DEVICE [[gnu::always_inline]]
#endif
