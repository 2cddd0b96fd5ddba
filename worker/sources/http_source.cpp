#include "worker/sources/http_source.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "common/voxel/store_header.h"

namespace quarry {

struct HttpVoxelSource::Impl : std::enable_shared_from_this<HttpVoxelSource::Impl> {
  struct Waiting {
    BlockKey block;
    Done done;
  };
  enum class Checked { kNo, kAsking, kYes };

  Impl(boost::asio::io_context& context, HttpLocation location, const Catalog& c, HttpOptions options)
      : io(context),
        catalog(c),
        name(location.text()),
        client(std::in_place, context, std::move(location), std::move(options)) {}

  /// Fetches the store's header, then its table, then the waiting blocks.
  void Check() {
    checked = Checked::kAsking;
    client->Get(0, kStoreHeaderBytes, [self = shared_from_this()](Result<HttpRangeClient::Reply> reply) {
      if (!reply) return self->FailCheck(reply.error());
      auto header = DecodeStoreHeader(reply->bytes, self->name);
      if (!header) return self->FailCheck(header.error());
      self->CheckTable(*header, reply->file_size);
    });
  }

  void CheckTable(const StoreHeader& header, uint64_t served) {
    if (served != 0 && served != header.file_size)
      return FailCheck(Error{WrongSizeText(name, served, header.file_size), ErrorKind::kPermanent});
    if (header.sections == 0)
      return FailCheck(Error{fmt::format("{}: a store without sections", name), ErrorKind::kPermanent});
    client->Get(kStoreHeaderBytes, static_cast<uint32_t>(header.table_bytes()),
                [self = shared_from_this(), header](Result<HttpRangeClient::Reply> reply) {
                  if (!reply) return self->FailCheck(reply.error());
                  Status status = CheckStoreTable(header, reply->bytes, self->name);
                  if (status) status = CheckSameStore(header, reply->bytes, self->catalog, self->name);
                  if (!status) return self->FailCheck(status.error());
                  self->file_size = header.file_size;
                  self->checked = Checked::kYes;
                  for (Waiting& w : std::exchange(self->waiting, {})) self->Ask(w.block, std::move(w.done));
                });
  }

  void FailCheck(const Error& error) {
    checked = Checked::kNo;
    for (Waiting& w : std::exchange(waiting, {})) {
      if (stopped) return;
      w.done(tl::unexpected<Error>(error));
    }
  }

  void Ask(BlockKey block, Done done) {
    const BlockEntry& entry = catalog.block(block);
    client->Get(entry.offset, entry.stored,
                [self = shared_from_this(), done = std::move(done)](Result<HttpRangeClient::Reply> reply) {
                  if (!reply) return done(tl::unexpected<Error>(reply.error()));
                  self->bytes_received += reply->bytes.size();
                  if (reply->file_size != 0 && reply->file_size != self->file_size) {
                    self->checked = Checked::kNo;
                    return done(tl::unexpected<Error>(Error{
                        fmt::format("{}: the store there has changed: it is {} bytes long, no longer {}",
                                    self->name, reply->file_size, self->file_size),
                        ErrorKind::kPermanent}));
                  }
                  done(std::move(reply->bytes));
                });
  }

  boost::asio::io_context& io;
  const Catalog& catalog;
  std::string name;
  std::optional<HttpRangeClient> client;
  std::vector<Waiting> waiting;  // for the check to end
  Checked checked = Checked::kNo;
  uint64_t file_size = 0, bytes_received = 0;
  bool stopped = false;
};

HttpVoxelSource::HttpVoxelSource(boost::asio::io_context& io, HttpLocation location, const Catalog& catalog,
                                 HttpOptions options)
    : impl_(std::make_shared<Impl>(io, std::move(location), catalog, std::move(options))) {}

HttpVoxelSource::~HttpVoxelSource() {
  impl_->stopped = true;
  impl_->waiting.clear();
  impl_->client.reset();
}

void HttpVoxelSource::Fetch(BlockKey block, Done done) {
  const Catalog& catalog = impl_->catalog;
  if (!catalog.Has(block)) {
    return boost::asio::post(impl_->io, [impl = impl_, block, done = std::move(done)] {
      if (!impl->stopped)
        done(tl::unexpected<Error>(
            Error{fmt::format("{}: has no block {}", impl->name, impl->catalog.NumberOf(block)),
                  ErrorKind::kPermanent}));
    });
  }
  if (impl_->checked == Impl::Checked::kYes) return impl_->Ask(block, std::move(done));
  impl_->waiting.push_back({block, std::move(done)});
  if (impl_->checked == Impl::Checked::kNo) impl_->Check();
}

HttpVoxelSource::Counters HttpVoxelSource::counters() const {
  return {impl_->bytes_received, impl_->client->counters()};
}

}  // namespace quarry
