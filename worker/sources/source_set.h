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

/// Blocks from several sources of one scene, and from other workers.
/// - Each block has a home among the sources (HomeOrder()). It goes to another source when the home fails or
/// is much slower. A damaged block (wrong size or checksum) counts as a failure.
/// - A failed source is left alone for a while (BackOff).
/// - When an answer is late, another source is asked too and the first answer counts (hedging). RetryBudget
/// limits hedges and retries.
/// - While no source may be asked, blocks wait.
/// Used from the io_context's thread.
class SourceSet final : public VoxelSource {
 public:
  struct Counters {
    std::array<uint64_t, kSourceKinds> bytes_from{};
    uint64_t retries = 0, hedges = 0, damaged = 0;
    uint64_t busy_us = 0;  ///< time during which any block was on its way, up to the last arrival
  };
  /// Fetch() fails when no source has given the block for `give_up_after_s` seconds, or when it has arrived
  /// damaged kMostDamaged times, or when every source has refused it. `log` gets a line when a source begins
  /// to fail and when it answers again.
  static constexpr int kMostDamaged = 6;
  SourceSet(boost::asio::io_context& io, const Catalog& catalog, double give_up_after_s,
            std::function<void(const std::string&)> log);
  ~SourceSet() override;

  /// Adds a source. `name` appears in logs; its hash is the source's key, so every machine computes the same
  /// homes.
  void Add(SourceKind kind, std::string name, std::unique_ptr<VoxelSource> source);
  /// Replaces the set of workers to ask.
  void SetPeers(const Peers& peers, std::function<std::unique_ptr<VoxelSource>(const Endpoint&)> make);
  /// A hint that `worker` has the block.
  void SetHolder(BlockKey block, uint32_t worker);

  /// Requires: the catalog has the block. `done` is called once, never after the destructor.
  void Fetch(BlockKey block, Done done) override;
  const Counters& counters() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry
