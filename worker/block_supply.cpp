#include "worker/block_supply.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <optional>
#include <utility>

#include "common/engine/blocks/file_source.h"
#include "common/net/source_spec.h"
#include "common/remote/open_store.h"
#include "worker/sources/http_source.h"
#include "worker/sources/tcp_source.h"

namespace quarry {

BlockSupply::BlockSupply(boost::asio::io_context& io, const Catalog& catalog, const SupplyOptions& options,
                         CacheInventory& inventory)
    : io_(io),
      catalog_(catalog),
      inventory_(inventory),
      idle_(options.idle),
      security_(options.security),
      serving_(options.serving),
      sources_(io, catalog, options.give_up_after_s, options.log),
      disk_(options.disk_cache
                ? std::make_unique<DiskCachedSource>(io, sources_, *options.disk_cache, catalog, options.log)
                : nullptr),
      stored_(disk_ ? static_cast<VoxelSource&>(*disk_) : sources_, options.stored_bytes, inventory),
      server_(catalog, stored_) {}

Result<std::unique_ptr<BlockSupply>> BlockSupply::Open(boost::asio::io_context& io, const Catalog& catalog,
                                                       const SupplyOptions& options,
                                                       CacheInventory& inventory) {
  std::unique_ptr<BlockSupply> supply(new BlockSupply(io, catalog, options, inventory));
  for (const std::string& text : options.sources)
    if (Status added = supply->Add(text, options); !added) {
      added.error().message = fmt::format("--source {}: {}", text, added.error().message);
      return tl::unexpected<Error>(added.error());
    }
  if (options.sources.empty()) QUARRY_TRY(supply->Add("master", options));
  return supply;
}

/// The master is trusted with the scene but not with this worker's tokens: a server that only the master
/// names gets headers and signatures only if `header_servers` lists it.
HttpOptions BlockSupply::HttpFor(const HttpLocation& location, const SupplyOptions& options) const {
  if (options.own_sources || (options.http.headers.empty() && !options.http.aws)) return options.http;
  HttpOptions http = OptionsFor(location, options.http, options.header_servers);
  if (http.headers.empty() && !http.aws)
    options.log(
        fmt::format("{} is named only by the master, and gets no headers or signatures; --http-header-host "
                    "{} allows them",
                    location.text(), location.authority()));
  return http;
}

Status BlockSupply::Add(const std::string& text, const SupplyOptions& options) {
  QUARRY_ASSIGN(const SourceSpec spec, ParseSource(text));
  switch (spec.kind) {
    case SourceKind::kFile: {
      QUARRY_ASSIGN(StoreReader store, StoreReader::Open(spec.place));
      if (store.catalog().id != catalog_.id)
        return Fail(fmt::format("{}: is another scene than the master's", spec.place));
      sources_.Add(spec.kind, text,
                   std::make_unique<FileVoxelSource>(
                       [this](std::function<void()> task) { boost::asio::post(io_, std::move(task)); },
                       std::make_shared<const StoreReader>(std::move(store))));
      return {};
    }
    case SourceKind::kTcp:
      sources_.Add(spec.kind, text,
                   std::make_unique<TcpVoxelSource>(io_, spec.master ? options.master : spec.server,
                                                    security_, catalog_));
      return {};
    default: {
      QUARRY_ASSIGN(HttpLocation location, RemoteLocation(spec.place, "--source"));
      const std::string name = location.text();
      HttpOptions http = HttpFor(location, options);
      if (options.own_sources) {
        QUARRY_ASSIGN(http, WithCredentials(spec.place, std::move(http)));
      }
      sources_.Add(spec.kind, name,
                   std::make_unique<HttpVoxelSource>(io_, std::move(location), catalog_, std::move(http)));
      return {};
    }
  }
}

void BlockSupply::SetPeers(const Peers& peers) {
  sources_.SetPeers(peers, [this](const Endpoint& endpoint) {
    return std::make_unique<TcpVoxelSource>(io_, endpoint, security_, catalog_);
  });
}

void BlockSupply::Expect(const TileOrder& order) {
  for (size_t i = 0; i < order.blocks.size(); ++i) {
    const std::optional<BlockKey> block = catalog_.BlockOf(order.blocks[i]);
    if (!block) continue;
    if (order.holders[i] != 0) sources_.SetHolder(*block, order.holders[i]);
    if (expected_.size() < kMostExpected) expected_.push_back(*block);
  }
}

void BlockSupply::Prefetch() {
  while (!expected_.empty() && stored_.prefetching() < kMostPrefetching && idle_()) {
    const BlockKey block = expected_.front();
    expected_.pop_front();
    if (!inventory_.Has(block)) stored_.Prefetch(block, [this] { Prefetch(); });
  }
}

}  // namespace quarry
