#pragma once

/// Marks what CPU and CUDA compile alike. The only macro of its kind; kernels name no other.
#ifdef __CUDACC__
#define QUARRY_HOST_DEVICE __host__ __device__
#else
#define QUARRY_HOST_DEVICE
#endif
