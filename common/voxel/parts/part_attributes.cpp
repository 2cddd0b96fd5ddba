#include "common/voxel/parts/part_attributes.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace quarry {
namespace {

/// Of an entry: the number of the part, then the bytes of its text.
constexpr uint64_t kEntryBytes = 2 * sizeof(uint32_t);
/// The entries are read in pieces of so many.
constexpr uint64_t kEntriesPerPiece = 65536;

}  // namespace

bool IsAttributes(std::string_view json) {
  if (json.size() > kMostAttributeBytes) return false;
  bool deep = false;
  using Event = nlohmann::json::parse_event_t;
  const auto keep = [&](int above, Event event, nlohmann::json&) {
    const bool begins = event == Event::object_start || event == Event::array_start;
    deep |= begins && above >= kMostAttributeLevels;
    return !deep;
  };
  const auto parsed = nlohmann::json::parse(json, keep, false);
  return !deep && parsed.is_object() && !parsed.empty();
}

Bytes EncodePartAttributes(std::span<const StatedAttributes> attributes) {
  ByteWriter out;
  if (attributes.empty()) return out.Take();
  out.Put(static_cast<uint32_t>(attributes.size()));
  for (const StatedAttributes& stated : attributes) {
    out.Put(stated.part);
    out.Put(static_cast<uint32_t>(stated.json.size()));
  }
  for (const StatedAttributes& stated : attributes) out.PutArray(stated.json);
  return out.Take();
}

tl::unexpected<Error> PartAttributes::Damaged(const std::string& how) const {
  return tl::unexpected<Error>(
      Error{fmt::format("{}: section PATT at byte {} is damaged ({}); make the store again", file_->path(),
                        section_, how),
            ErrorKind::kPermanent});
}

Result<PartAttributes> PartAttributes::Read(const RandomAccessFile& file, StoreNames::Place place,
                                            uint64_t part_count) {
  PartAttributes all(file, place.offset);
  if (place.size == 0) return all;
  uint32_t count = 0;
  if (place.size < sizeof count) return all.Damaged("it ends too early");
  QUARRY_TRY(file.ReadAt(place.offset, std::as_writable_bytes(std::span(&count, 1))));
  if (count > part_count || (place.size - sizeof count) / kEntryBytes < count)
    return all.Damaged("more entries than there is room or parts for");
  uint64_t at = place.offset + sizeof count, text = at + count * kEntryBytes;
  Bytes piece;
  while (all.entries_.size() < count) {
    piece.resize(std::min(kEntriesPerPiece, count - all.entries_.size()) * kEntryBytes);
    QUARRY_TRY(file.ReadAt(at, piece));
    at += piece.size();
    ByteReader in(piece);
    while (in.remaining() > 0) {
      Entry entry;
      entry.part = in.Get<uint32_t>();
      entry.bytes = in.Get<uint32_t>();
      entry.begin = text;
      text += entry.bytes;
      if (entry.part >= part_count || (!all.entries_.empty() && entry.part <= all.entries_.back().part))
        return all.Damaged("parts out of order");
      if (entry.bytes == 0 || entry.bytes > kMostAttributeBytes)
        return all.Damaged(fmt::format("the attributes of part {} have {} bytes", entry.part, entry.bytes));
      all.entries_.push_back(entry);
    }
  }
  if (text != place.offset + place.size) return all.Damaged("another size than its entries state");
  return all;
}

Result<std::string> PartAttributes::Text(const Entry& entry) const {
  std::string text(entry.bytes, '\0');
  QUARRY_TRY(file_->ReadAt(entry.begin, std::as_writable_bytes(std::span(text))));
  if (!IsAttributes(text))
    return Damaged(fmt::format("the attributes of part {} are not an object of JSON", entry.part));
  return text;
}

Result<std::string> PartAttributes::Of(uint32_t part) const {
  const auto found = std::ranges::lower_bound(entries_, part, {}, &Entry::part);
  if (found == entries_.end() || found->part != part) return std::string();
  return Text(*found);
}

Status PartAttributes::Check() const {
  for (const Entry& entry : entries_) QUARRY_TRY(Text(entry).map([](auto&&) {}));
  return {};
}

}  // namespace quarry
