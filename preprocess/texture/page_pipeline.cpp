#include "preprocess/texture/page_pipeline.h"

#include <algorithm>

namespace quarry {
namespace {

constexpr size_t kBatchPages = 64;

}  // namespace

PagePipeline::~PagePipeline() {
  if (under_way_.valid()) under_way_.wait();
}

Status PagePipeline::Add(uint32_t page, std::span<const std::byte> texels) {
  gathered_.push_back({page, Bytes(texels.begin(), texels.end()), {}});
  return gathered_.size() == kBatchPages ? HandOver() : Status{};
}

Status PagePipeline::Finish() {
  if (!gathered_.empty()) QUARRY_TRY(HandOver());
  return under_way_.valid() ? under_way_.get() : Status{};
}

Status PagePipeline::HandOver() {
  if (under_way_.valid()) QUARRY_TRY(under_way_.get());
  batch_.clear();
  std::swap(batch_, gathered_);
  if (threads_ == 1) return EncodeBatch();
  under_way_ = std::async(std::launch::async, [this] { return EncodeBatch(); });
  return {};
}

Status PagePipeline::EncodeBatch() {
  const TexelLayout& layout = writer_.textures().back().texture.layout;
  const TextureShape shape(layout.width, layout.height);
  const auto encode = [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i)
      batch_[i].encoded = EncodeTexturePage(shape, layout, batch_[i].page, batch_[i].texels);
  };
  // The thread that makes the levels is busy too.
  const size_t slices = std::max<size_t>(threads_ - 1, 1), each = (batch_.size() + slices - 1) / slices;
  std::vector<std::future<void>> others;
  for (size_t begin = each; begin < batch_.size(); begin += each)
    others.push_back(std::async(std::launch::async, encode, begin, std::min(begin + each, batch_.size())));
  encode(0, std::min(each, batch_.size()));
  for (auto& other : others) other.get();
  for (const Task& task : batch_) QUARRY_TRY(writer_.AddPage(task.page, task.encoded));
  return {};
}

}  // namespace quarry
