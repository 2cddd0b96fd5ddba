#include "preprocess/import/cad/open_cascade/cad_output.h"

#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>

#include "common/base/descriptor.h"
#include "common/program/processor_time.h"

namespace quarry {
namespace {

constexpr size_t kPieceBytes = 1 << 18;
/// Processor time between two signs of progress, at most: one part of 100,000 faces takes a minute.
constexpr rlim_t kMostSecondsOfStep = 600;
/// No single allocation of Open CASCADE's is larger than this in files that fit into memory.
constexpr uint64_t kMargin = 64u << 20;

}  // namespace

void CadOutput::Put(CadMessage kind, std::span<const std::byte> content) {
  ByteWriter header;
  header.Put(static_cast<uint32_t>(kind));
  header.Put(static_cast<uint32_t>(content.size()));
  gathered_.insert(gathered_.end(), header.bytes().begin(), header.bytes().end());
  gathered_.insert(gathered_.end(), content.begin(), content.end());
  if (gathered_.size() >= kPieceBytes) Flush();
}

void CadOutput::Put(CadMessage kind, std::string_view text) {
  Put(kind, AsBytes(text.substr(0, kMostCadText)));
}

void CadOutput::Progress(double share) {
  LimitProcessorTime(kMostSecondsOfStep);
  constexpr double kStep = 0.002;
  if (share < reported_ + kStep) return;
  reported_ = share;
  ByteWriter content;
  content.Put(share);
  Put(CadMessage::kProgress, content.bytes());
  Flush();
}

void CadOutput::Flush() {
  if (!WriteAll(fd_, gathered_)) std::_Exit(1);  // the reader is gone: nothing is left to do
  gathered_.clear();
}

bool MemoryIsShort(bool losses) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return false;
  std::ifstream status("/proc/self/status");
  std::string line;
  constexpr std::string_view kPeak = "VmPeak:";
  while (std::getline(status, line))
    if (line.starts_with(kPeak))
      return (std::strtoull(line.c_str() + kPeak.size(), nullptr, 10) << 10) +
                 (losses ? std::max<uint64_t>(kMargin, limit.rlim_cur / 4) : kMargin) >
             limit.rlim_cur;
  return false;
}

}  // namespace quarry
