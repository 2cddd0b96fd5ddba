#pragma once

#include <cstdint>
#include <string>

#include "tests/cuda/trace_cuda.h"

// What launches of kernels share.

namespace quarry::cuda {

inline Status Check(cudaError_t error, const char* what) {
  if (error == cudaSuccess) return {};
  return Fail(std::string("CUDA cannot ") + what + ": " + cudaGetErrorString(error));
}

/// Events that time what lies between them.
class Timer {
 public:
  ~Timer() {
    for (cudaEvent_t event : events_)
      if (event) cudaEventDestroy(event);
  }
  Status Start() {
    for (cudaEvent_t& event : events_) QUARRY_TRY(Check(cudaEventCreate(&event), "make an event"));
    return Check(cudaEventRecord(events_[0]), "record an event");
  }
  /// Seconds since Start(), once the device has done all work. `what`: that work, for errors.
  Result<double> Stop(const char* what) {
    QUARRY_TRY(Check(cudaGetLastError(), what));
    QUARRY_TRY(Check(cudaEventRecord(events_[1]), what));
    QUARRY_TRY(Check(cudaEventSynchronize(events_[1]), what));
    float ms = 0;
    QUARRY_TRY(Check(cudaEventElapsedTime(&ms, events_[0], events_[1]), "read an event"));
    return ms * 1e-3;
  }

 private:
  cudaEvent_t events_[2] = {};
};

inline uint32_t BlocksFor(uint32_t threads) { return (threads + kBlockThreads - 1) / kBlockThreads; }

}  // namespace quarry::cuda
