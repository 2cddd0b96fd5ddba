#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/engine/blocks/voxel_source.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Blocks from several sources that share one scene, and from other workers. Every block has a home among the
/// sources (HomeOrder) and goes to the others when the home fails or is much slower; one that comes damaged
/// (size or checksum not the directory's) counts as a failure. A source that fails is left alone for a while
/// (BackOff). An answer that is late is asked for elsewhere as well, the first counts (hedging); RetryBudget
/// bounds that and all retries. While nothing can be asked, blocks wait. Used from the io_context's thread.
class SourceSet final : public VoxelSource {
 public:
  struct Counters {
    std::array<uint64_t, kSourceKinds> bytes_from{};
    uint64_t retries = 0, hedges = 0, damaged = 0;
    uint64_t busy_us = 0;  ///< in which blocks were on their way, up to the last that has come
  };
  /// `log`: one line when a source fails that did not, and when it is back. A fetch ends with an error when
  /// no source has given the block for `give_up_after_s`, or it has come damaged or been refused kMostDamaged
  /// times.
  static constexpr int kMostDamaged = 6;
  SourceSet(boost::asio::io_context& io, const Catalog& catalog, double give_up_after_s,
            std::function<void(const std::string&)> log);
  ~SourceSet() override;

  /// `name` is what the logs say, and with it every machine reckons the same homes.
  void Add(SourceKind kind, std::string name, std::unique_ptr<VoxelSource> source);
  /// The workers to be asked from now on, instead of those before.
  void SetPeers(const Peers& peers, std::function<std::unique_ptr<VoxelSource>(const Endpoint&)> make);
  /// A hint: `worker` has the block.
  void SetHolder(BlockKey block, uint32_t worker);

  void Fetch(BlockKey block, Done done) override;
  const Counters& counters() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry
