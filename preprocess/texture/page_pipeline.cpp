#include "preprocess/texture/page_pipeline.h"

#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <deque>
#include <future>
#include <optional>
#include <utility>

namespace quarry {
namespace {

constexpr size_t kMostPages = 128;

}  // namespace

struct PagePipeline::Impl {
  /// A page under way, or a step.
  struct Entry {
    uint32_t page = 0;
    std::future<EncodedPage> encoded;
    std::function<Status()> step;
  };

  Impl(StoreWriter& to, unsigned threads) : writer(to) {
    if (threads > 1) pool.emplace(threads);
  }

  Status TakeOldest() {
    Entry entry = std::move(entries.front());
    entries.pop_front();
    if (entry.step) return entry.step();
    --pages;
    return writer.AddPage(entry.page, entry.encoded.get());
  }

  /// Takes finished entries, so that steps run soon; waits only beyond kMostPages.
  Status TakeDone() {
    while (!entries.empty() &&
           (entries.front().step || pages > kMostPages ||
            entries.front().encoded.wait_for(std::chrono::seconds(0)) == std::future_status::ready))
      QUARRY_TRY(TakeOldest());
    return {};
  }

  StoreWriter& writer;
  TexelLayout layout;
  std::deque<Entry> entries;
  size_t pages = 0;  ///< among the entries
  std::optional<boost::asio::thread_pool> pool;
};

PagePipeline::PagePipeline(StoreWriter& writer, unsigned threads)
    : impl_(std::make_unique<Impl>(writer, threads)) {}

PagePipeline::~PagePipeline() {
  if (impl_->pool) impl_->pool->join();
}

void PagePipeline::Begin(const TexelLayout& layout) { impl_->layout = layout; }

Status PagePipeline::Add(uint32_t page, std::span<const std::byte> texels) {
  const TexelLayout layout = impl_->layout;
  if (!impl_->pool)
    return impl_->writer.AddPage(
        page, EncodeTexturePage(TextureShape(layout.width, layout.height), layout, page, texels));
  auto work = std::make_shared<std::packaged_task<EncodedPage()>>(
      [layout, page, copy = Bytes(texels.begin(), texels.end())] {
        return EncodeTexturePage(TextureShape(layout.width, layout.height), layout, page, copy);
      });
  impl_->entries.push_back({page, work->get_future(), {}});
  ++impl_->pages;
  boost::asio::post(*impl_->pool, [work] { (*work)(); });
  return impl_->TakeDone();
}

Status PagePipeline::Then(std::function<Status()> step) {
  impl_->entries.push_back({0, {}, std::move(step)});
  return impl_->TakeDone();
}

Status PagePipeline::Finish() {
  while (!impl_->entries.empty()) QUARRY_TRY(impl_->TakeOldest());
  return {};
}

}  // namespace quarry
