#include "common/voxel/parts/part_sections.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "common/voxel/parts/part_path.h"

namespace quarry {
namespace {

/// PTRE is read in pieces of so many parts, 640 KiB.
constexpr uint64_t kPartsPerPiece = 16384;
constexpr uint64_t kWindowBytes = 256 << 10;

void PutNumber(uint32_t number, Bytes& out) {
  constexpr uint32_t kMore = 0x80;
  for (; number >= kMore; number >>= 7) out.push_back(static_cast<std::byte>(number | kMore));
  out.push_back(static_cast<std::byte>(number));
}

/// Sorts parts and keeps each once. Those of a voxel mostly lie close together, so that a bit for each number
/// between the least and the greatest is quicker than a sort of all.
void KeepDistinct(std::vector<uint32_t>& parts) {
  constexpr uint32_t kBits = 64;
  if (parts.empty()) return;
  const auto [first, last] = std::ranges::minmax(parts);
  const uint32_t words = (last - first) / kBits + 1;
  if (words > parts.size()) {
    std::ranges::sort(parts);
    parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
    return;
  }
  std::vector<uint64_t> met(words);
  for (const uint32_t part : parts) met[(part - first) / kBits] |= uint64_t{1} << (part - first) % kBits;
  parts.clear();
  for (uint32_t word = 0; word < words; ++word)
    for (uint64_t left = met[word]; left != 0; left &= left - 1)
      parts.push_back(first + word * kBits + static_cast<uint32_t>(std::countr_zero(left)));
}

ScenePart GetPart(ByteReader& in) {
  ScenePart part;
  part.parent = in.Get<uint32_t>();
  part.flags = in.Get<uint32_t>();
  part.triangles = in.Get<uint64_t>();
  part.lower = in.GetVec3<glm::vec3>();
  part.upper = in.GetVec3<glm::vec3>();
  return part;
}

bool HasBox(const ScenePart& part) {
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(part.lower[axis]) || !std::isfinite(part.upper[axis]) ||
        part.lower[axis] > part.upper[axis])
      return false;
  return part.triangles > 0;
}

/// The fault of a part's facts apart from its place in the tree; null: none.
const char* FaultOf(const ScenePart& part) {
  const ScenePart none;
  if (part.flags > (ScenePart::kClosed | ScenePart::kInsideOut) || part.flags == ScenePart::kInsideOut)
    return "unknown flags";
  if (part.flags != 0 && part.triangles == 0) return "a surface without triangles";
  if (!HasBox(part) && !(part.lower == none.lower && part.upper == none.upper)) return "an impossible box";
  return nullptr;
}

}  // namespace

Bytes EncodePartTree(std::span<const ScenePart> parts) {
  ByteWriter out;
  for (const ScenePart& part : parts) {
    out.Put(part.parent);
    out.Put(part.flags);
    out.Put(part.triangles);
    out.PutVec3(part.lower);
    out.PutVec3(part.upper);
  }
  return out.Take();
}

Bytes EncodePartList(std::vector<uint32_t> parts) {
  KeepDistinct(parts);
  Bytes out;
  PutNumber(static_cast<uint32_t>(parts.size()), out);
  uint32_t before = 0;
  for (const uint32_t part : parts) PutNumber(part - std::exchange(before, part), out);
  return out;
}

tl::unexpected<Error> PartListReader::Damaged(const char* how) const {
  return tl::unexpected<Error>(
      Error{fmt::format("{}: section VPRT at byte {} is damaged ({}); make the store again", file_.path(),
                        place_.offset, how),
            ErrorKind::kPermanent});
}

/// Reads 32 bits, 7 a byte, lowest first.
Result<uint32_t> PartListReader::Number() {
  uint64_t number = 0;
  for (int shift = 0; shift < 35; shift += 7) {
    if (at_ == window_.size()) {
      if (read_ == place_.size) return Damaged("it ends too early");
      window_.resize(std::min(kWindowBytes, place_.size - read_));
      QUARRY_TRY(file_.ReadAt(place_.offset + read_, window_));
      read_ += window_.size();
      at_ = 0;
    }
    const auto byte = static_cast<uint64_t>(window_[at_++]);
    number |= (byte & 0x7F) << shift;
    if (byte >= 0x80) continue;
    if (number > 0xFFFFFFFFu) break;
    return static_cast<uint32_t>(number);
  }
  return Damaged("a number has more than 32 bits");
}

Result<std::span<const uint32_t>> PartListReader::Next(uint32_t triangles) {
  QUARRY_ASSIGN(const uint32_t count, Number());
  if (count == 0 || count > triangles) return Damaged("a voxel has another number of parts");
  parts_.clear();
  uint64_t part = 0;
  for (uint32_t i = 0; i < count; ++i) {
    QUARRY_ASSIGN(const uint32_t step, Number());
    if (i > 0 && step == 0) return Damaged("parts out of order");
    part += step;
    if (part >= part_count_) return Damaged("a part that does not exist");
    parts_.push_back(static_cast<uint32_t>(part));
  }
  return std::span<const uint32_t>(parts_);
}

Status PartListReader::CheckEnd() const {
  if (read_ == place_.size && at_ == window_.size()) return {};
  return Damaged("bytes after the last voxel's list");
}

tl::unexpected<Error> PartSections::Damaged(const std::string& how) const {
  return tl::unexpected<Error>(
      Error{fmt::format("{}: section PTRE at byte {} is damaged ({}); make the store again", file_.path(),
                        places_.tree.offset, how),
            ErrorKind::kPermanent});
}

Result<std::vector<ScenePart>> PartSections::ReadTree(uint64_t input_triangles) const {
  const uint64_t count = names_.part_count();
  if (!has_tree()) return std::vector<ScenePart>(count);
  if (places_.tree.size != count * kScenePartBytes) return Damaged("another number of parts than PART has");
  std::vector<ScenePart> parts;
  std::vector<uint16_t> levels;
  parts.reserve(count);
  levels.reserve(count);
  Bytes piece;
  while (parts.size() < count) {
    piece.resize(std::min(kPartsPerPiece, count - parts.size()) * kScenePartBytes);
    QUARRY_TRY(file_.ReadAt(places_.tree.offset + parts.size() * kScenePartBytes, piece));
    ByteReader in(piece);
    while (in.remaining() > 0) {
      const ScenePart part = GetPart(in);
      const bool root = part.parent == ScenePart::kNoParent;
      if (!root && part.parent >= parts.size())
        return Damaged(fmt::format("the parent of part {} does not come before it", parts.size()));
      levels.push_back(root ? 1 : static_cast<uint16_t>(levels[part.parent] + 1));
      if (levels.back() > kMostPartLevels)
        return Damaged(fmt::format("part {} lies more than {} levels deep", parts.size(), kMostPartLevels));
      if (const char* const fault = FaultOf(part))
        return Damaged(fmt::format("part {} has {}", parts.size(), fault));
      if (part.triangles > input_triangles) return Damaged("more triangles than META states");
      input_triangles -= part.triangles;
      parts.push_back(part);
    }
  }
  return parts;
}

Result<uint32_t> PartSections::ParentOf(uint32_t part) const {
  if (!has_tree()) return ScenePart::kNoParent;
  if (places_.tree.size / kScenePartBytes <= part) return Damaged("another number of parts than PART has");
  uint32_t parent = 0;
  QUARRY_TRY(file_.ReadAt(places_.tree.offset + part * kScenePartBytes,
                          std::as_writable_bytes(std::span(&parent, 1))));
  if (parent != ScenePart::kNoParent && parent >= part)
    return Damaged(fmt::format("the parent of part {} does not come before it", part));
  return parent;
}

Result<std::string> PartSections::Path(uint32_t part) const {
  if (part >= names_.part_count()) return std::string();
  std::vector<uint32_t> way{part};
  for (;;) {
    QUARRY_ASSIGN(const uint32_t parent, ParentOf(way.back()));
    if (parent == ScenePart::kNoParent) break;
    way.push_back(parent);
    if (way.size() > kMostPartLevels)
      return Damaged(fmt::format("part {} lies more than {} levels deep", part, kMostPartLevels));
  }
  std::string path;
  for (size_t i = way.size(); i-- > 0;) {
    QUARRY_ASSIGN(const std::string name, names_.Part(way[i]));
    AppendToPath(name, path, i + 1 == way.size());
  }
  return path;
}

}  // namespace quarry
