#include "common/engine/blocks/voxel_cache.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "common/base/check.h"

namespace quarry {
namespace {

/// Memory of evicted blocks that the cache of a scene without room in it keeps for the next ones. Trades room
/// for blocks against mapping memory anew. A 32nd of 384 MiB holds about 100 blocks; nearly every new block
/// then finds its size. A 32nd of less than 16 MiB would hold too few.
uint64_t SpareBytesOf(uint64_t budget) {
  constexpr uint64_t kLeast = 16 << 20, kShare = 32, kMost = 64 << 20;
  if (budget < kLeast) return 0;
  return std::min(budget / kShare, kMost);
}

}  // namespace

void Mailbox::Deliver(BlockKey block, VoxelCache& from) {
  {
    const std::lock_guard lock(mutex_);
    from_ = &from;
    delivered_.push_back(block);
  }
  changed_.notify_one();
}

void Mailbox::Wake() {
  {
    const std::lock_guard lock(mutex_);
    woken_ = true;
  }
  changed_.notify_one();
}

std::vector<BlockKey> Mailbox::Take(bool wait) {
  std::unique_lock lock(mutex_);
  if (const uint32_t used = std::exchange(in_use_, 0); used != 0) {
    VoxelCache* const from = from_;
    lock.unlock();  // Used() takes the cache's lock
    from->Used(used);
    lock.lock();
  }
  if (wait) changed_.wait(lock, [&] { return woken_ || !delivered_.empty(); });
  woken_ = false;
  in_use_ = static_cast<uint32_t>(delivered_.size());
  return std::exchange(delivered_, {});
}

VoxelCache::VoxelCache(const Catalog& catalog, uint64_t budget_bytes, std::function<void()> on_want,
                       std::function<void()> on_space, std::function<void(BlockKey, bool)> on_change)
    : budget_(budget_bytes),
      has_room_(catalog.DecodedBytes() <= budget_bytes),
      spare_bytes_(has_room_ ? 0 : SpareBytesOf(budget_bytes)),
      spare_(spare_bytes_),
      on_want_(std::move(on_want)),
      on_space_(std::move(on_space)),
      on_change_(std::move(on_change)),
      slots_(catalog, budget_bytes),
      order_(catalog) {}

VoxelCache::~VoxelCache() {
  for (const Resident& r : residents_) delete slots_[r.block].resident.load();
}

uint64_t VoxelCache::RoomOf(BlockKey block) const {
  const uint32_t decoded = slots_.EntryOf(block).decoded;
  return block.is_page() ? PageRoom(decoded) : decoded;
}

const ResidentBlock* VoxelCache::TryPin(BlockKey block) {
  BlockSlots::Slot& slot = slots_[block];
  uint32_t state = slot.state.load(std::memory_order_relaxed);
  do {
    if (!(state & BlockSlots::kResident)) return nullptr;
  } while (!slot.state.compare_exchange_weak(state, state + 1, std::memory_order_acquire));
  slot.last_use.store(static_cast<uint32_t>(clock_.fetch_add(1, std::memory_order_relaxed)),
                      std::memory_order_release);
  return slot.resident.load(std::memory_order_acquire);
}

void VoxelCache::Unpin(BlockKey block) {
  const uint32_t before = slots_[block].state.fetch_sub(1);
  QUARRY_DCHECK((before & ~BlockSlots::kResident) > 0);
  if ((before & ~BlockSlots::kResident) == 1 && starved_.exchange(false)) on_space_();
}

void VoxelCache::Want(BlockKey block, Mailbox* mailbox, uint32_t rays, OctantMask octants) {
  {
    const std::lock_guard lock(mutex_);
    // Eviction and publication hold the lock too, so the answer stays true until the mailbox is on the list.
    if (!TryPin(block)) {
      Waiting& w = waiting_[block];
      if (w.rays == 0) {
        w.since = std::chrono::steady_clock::now();
        wanted_bytes_ += RoomOf(block);
      }
      w.rays += rays;
      const auto more = static_cast<OctantMask>(octants & ~w.octants);
      w.octants |= octants;
      sweep_.Add({block, more});
      if (std::find(w.mailboxes.begin(), w.mailboxes.end(), mailbox) == w.mailboxes.end())
        w.mailboxes.push_back(mailbox);
      mailbox = nullptr;
    } else {
      ++in_use_;
    }
  }
  if (mailbox)
    mailbox->Deliver(block, *this);
  else
    on_want_();
}

void VoxelCache::Used(uint32_t blocks) {
  bool go_on = false;
  {
    const std::lock_guard lock(mutex_);
    in_use_ -= blocks;
    go_on = in_use_ == 0 && scarce();
  }
  if (go_on) on_want_();
}

std::optional<BlockKey> VoxelCache::NextInSweep(bool loading_too) const {
  return sweep_.Next([&](BlockKey block) { return !loading_too && waiting_.at(block).loading; });
}

VoxelCache::Turn VoxelCache::NextToPublish() const {
  const std::lock_guard lock(mutex_);
  if (!scarce()) return {true, {}};
  if (in_use_ != 0) return {};
  return {false, NextInSweep(true)};
}

std::optional<BlockKey> VoxelCache::TurnToLoad() {
  const std::lock_guard lock(mutex_);
  if (!scarce()) return {};
  const auto next = NextInSweep(true);
  if (!next || std::exchange(waiting_[*next].loading, true)) return {};
  return next;
}

std::optional<BlockKey> VoxelCache::NextToLoad() {
  const std::lock_guard lock(mutex_);
  if (!has_room_ || scarce()) {
    const auto next = NextInSweep(false);
    if (next) waiting_[*next].loading = true;
    return next;
  }
  const auto now = std::chrono::steady_clock::now();
  std::optional<BlockKey> best;
  double best_worth = -1;
  for (const auto& [block, w] : waiting_) {
    if (w.loading) continue;
    const double waited_s = std::chrono::duration<double>(now - w.since).count();
    const double worth = static_cast<double>(w.rays) * (waited_s + 1e-3);
    if (worth > best_worth) {
      best_worth = worth;
      best = block;
    }
  }
  if (best) waiting_[*best].loading = true;
  return best;
}

/// When a block was last used. Slots keep the low half; blocks whose last use is 2^32 uses ago count as used
/// lately.
uint64_t VoxelCache::LastUse(BlockKey block) const {
  // The use before the clock: a use in between would seem to lie ahead of it.
  const uint32_t used = slots_[block].last_use.load(std::memory_order_acquire);
  const uint64_t now = clock_.load(std::memory_order_relaxed);
  return now - static_cast<uint32_t>(static_cast<uint32_t>(now) - used);
}

void VoxelCache::AddResident(const Resident& resident) {
  residents_.push_back(resident);
  std::ranges::push_heap(residents_, std::greater());
}

bool VoxelCache::EvictOne(std::vector<BlockKey>& evicted) {
  // A use does not move its block in the heap: a block that has been used since is put back when it comes up.
  std::vector<Resident> pinned;
  bool found = false;
  while (!found && !residents_.empty()) {
    std::ranges::pop_heap(residents_, std::greater());
    const Resident oldest = residents_.back();
    residents_.pop_back();
    const uint64_t used = LastUse(oldest.block);
    if (used != oldest.used) {
      AddResident({used, oldest.block});
    } else if (TryEvict(oldest.block)) {
      evicted.push_back(oldest.block);
      found = true;
    } else {
      pinned.push_back(oldest);
    }
  }
  for (const Resident& resident : pinned) AddResident(resident);
  return found;
}

/// Evicts a block unless it is pinned.
bool VoxelCache::TryEvict(BlockKey block) {
  BlockSlots::Slot& slot = slots_[block];
  uint32_t unpinned = BlockSlots::kResident;
  if (!slot.state.compare_exchange_strong(unpinned, 0)) return false;
  ResidentBlock* gone = slot.resident.exchange(nullptr);
  used_ -= RoomOf(block);
  slack_ -= gone->bytes.slack();
  ++counters_.evictions;
  unused_ = PageBuffer();  // from now on each block takes the pages of an evicted block
  spare_unit_ = PageBuffer();
  if (gone->bytes.is_unit())
    spare_unit_ = std::move(gone->bytes);
  else
    spare_.Keep(std::move(gone->bytes));
  delete gone;
  return true;
}

bool VoxelCache::MakeRoom(uint64_t bytes, std::vector<BlockKey>& evicted) {
  const std::lock_guard lock(mutex_);
  QUARRY_CHECK_LE(bytes, budget_);
  const bool keeps_spare = bytes <= budget_ - spare_bytes_;
  while (used_ + slack_ + bytes > budget_ - (keeps_spare ? spare_bytes_ : 0)) {
    if (EvictOne(evicted)) continue;
    // The flag is raised before the second look: an unpinning in between is either seen here or sees the
    // flag.
    starved_.store(true);
    if (!EvictOne(evicted)) return false;
    starved_.store(false);
  }
  used_ += bytes;
  return true;
}

bool VoxelCache::Reserve(BlockKey block) {
  std::vector<BlockKey> evicted;
  const bool has_room = MakeRoom(RoomOf(block), evicted);
  if (on_change_)
    for (const BlockKey gone : evicted) on_change_(gone, false);
  return has_room;
}

uint64_t VoxelCache::MostSlack(uint32_t decoded_bytes) const {
  constexpr uint64_t kShare = 16;
  const uint64_t taken = used_ + slack_ + spare_bytes_;
  return taken < budget_ ? std::min(budget_ - taken, decoded_bytes / kShare) : 0;
}

std::optional<PageBuffer> VoxelCache::TakePages(uint32_t decoded_bytes, bool small) {
  if (small) {
    spare_.Trim();
    if (spare_unit_.is_unit() && spare_unit_.Resize(decoded_bytes)) return std::move(spare_unit_);
    spare_unit_ = PageBuffer();
    return slabs_.Take(decoded_bytes, unused_);
  }
  spare_unit_ = PageBuffer();
  if (auto spare = spare_.Take(decoded_bytes, MostSlack(decoded_bytes))) {
    slack_ += spare->slack();
    spare_.Trim();
    if (used_ > budget_ - spare_bytes_) spare_.Clear();  // the blocks leave no room for them
    return spare;
  }
  if (decoded_bytes <= unused_.bytes().size()) return unused_.TakeFront(decoded_bytes);
  unused_ = PageBuffer();
  spare_.Clear();
  return PageBuffer::TryGet(decoded_bytes);
}

void VoxelCache::UseFirst(PageBuffer memory) {
  unused_ = std::move(memory);
  if (unused_.bytes().size() > budget_ && !unused_.Resize(budget_)) unused_ = PageBuffer();
}

void VoxelCache::Publish(BlockKey block, std::unique_ptr<ResidentBlock> resident) {
  std::vector<Mailbox*> mailboxes;
  {
    const std::lock_guard lock(mutex_);
    const auto it = waiting_.find(block);
    if (it != waiting_.end()) {
      mailboxes = std::move(it->second.mailboxes);
      sweep_.MoveTo({block, it->second.octants});
      sweep_.Remove({block, it->second.octants});
      wanted_bytes_ -= RoomOf(block);
      in_use_ += static_cast<uint32_t>(mailboxes.size());
      waiting_.erase(it);
    }
    ++counters_.loaded;
    counters_.bytes_loaded += resident->bytes.bytes().size();
    BlockSlots::Slot& slot = slots_[block];
    const uint64_t now = clock_.fetch_add(1);
    slot.last_use.store(static_cast<uint32_t>(now));
    slot.resident.store(resident.release(), std::memory_order_release);
    AddResident({now, block});
    slot.state.store(BlockSlots::kResident + static_cast<uint32_t>(mailboxes.size()),
                     std::memory_order_release);
  }
  if (on_change_) on_change_(block, true);
  for (Mailbox* mailbox : mailboxes) mailbox->Deliver(block, *this);
}

VoxelCache::Counters VoxelCache::counters() const {
  const std::lock_guard lock(mutex_);
  Counters c = counters_;
  c.bytes = used_;
  return c;
}

}  // namespace quarry
