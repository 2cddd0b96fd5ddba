#include "preprocess/spill/spill_files.h"

#include <fmt/format.h>

#include <algorithm>

namespace quarry {

Result<SpillFiles> SpillFiles::Open(const std::string& prefix, size_t files, size_t element_bytes,
                                    const Options& options) {
  constexpr size_t kLeastBlock = 4096, kMostBlock = 256 << 10;
  SpillFiles opened;
  SpillFile::Options each;
  each.block_bytes = std::clamp<size_t>(options.memory / files, kLeastBlock, kMostBlock);
  each.writer = opened.writer_.get();
  each.pack_from = options.pack_from;
  opened.files_.reserve(files);
  for (size_t i = 0; i < files; ++i) {
    const uint64_t count = options.counts.empty() || i < options.gone ? 0 : options.counts[i];
    QUARRY_ASSIGN(SpillFile file,
                  SpillFile::Open(fmt::format("{}{}", prefix, i), element_bytes, count, each));
    opened.files_.push_back(std::move(file));
  }
  return opened;
}

Status SpillFiles::FinishWriting() {
  for (SpillFile& file : files_) QUARRY_TRY(file.FinishWriting());
  return {};
}

Status SpillFiles::WriteOut() {
  for (SpillFile& file : files_) QUARRY_TRY(file.Flush());
  return writer_->Wait();
}

std::vector<uint64_t> SpillFiles::counts() const {
  std::vector<uint64_t> counts;
  counts.reserve(files_.size());
  for (const SpillFile& file : files_) counts.push_back(file.count());
  return counts;
}

}  // namespace quarry
