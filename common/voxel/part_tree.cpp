#include "common/voxel/part_tree.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <glm/common.hpp>
#include <limits>
#include <utility>

#include "common/base/log.h"
#include "common/voxel/parts/part_path.h"
#include "common/voxel/store_reader.h"

namespace quarry {
namespace {

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c | 0x20) : c; }

std::string Lowered(std::string_view text) {
  std::string lower(text);
  std::ranges::transform(lower, lower.begin(), Lower);
  return lower;
}

/// Whether `name` begins (ends) with `lower`, which has no capitals.
bool Begins(std::string_view name, std::string_view lower) {
  return name.size() >= lower.size() && std::ranges::equal(name.substr(0, lower.size()), lower, {}, Lower);
}
bool Ends(std::string_view name, std::string_view lower) {
  return name.size() >= lower.size() && Begins(name.substr(name.size() - lower.size()), lower);
}

/// A path for a sentence: readable and not too long.
std::string Quoted(std::string_view path) {
  constexpr size_t kMostLetters = 300;
  return fmt::format("`{}{}`", PrintableName(path.substr(0, kMostLetters)),
                     path.size() > kMostLetters ? "..." : "");
}

}  // namespace

Result<std::shared_ptr<const PartTree>> PartTree::Read(const StoreReader& store) {
  const std::shared_ptr<PartTree> tree(new PartTree);
  QUARRY_ASSIGN(tree->parts_, store.part_sections().ReadTree(store.catalog().meta.input_triangles));
  tree->has_tree_ = store.part_sections().has_tree();
  const uint32_t parts = tree->size();
  tree->name_begin_.reserve(size_t{parts} + 1);
  tree->name_begin_.push_back(0);
  for (uint32_t part = 0; part < parts; ++part) {
    QUARRY_ASSIGN(const std::string name, store.PartName(part));
    tree->names_.append(name).push_back('\0');
    if (tree->names_.size() > std::min<uint64_t>(store.name_bytes() + 1, 0xFFFFFFFFu))
      return tl::unexpected<Error>(Error{
          fmt::format("{}: its entries refer to more names than it has; make the store again", store.path()),
          ErrorKind::kPermanent});
    tree->name_begin_.push_back(static_cast<uint32_t>(tree->names_.size()));
  }
  tree->names_.shrink_to_fit();
  tree->Index();
  return std::shared_ptr<const PartTree>(tree);
}

/// Makes totals, children and the table of hashes.
void PartTree::Index() {
  const uint32_t parts = size();
  totals_.reserve(parts);
  for (const Part& part : parts_) totals_.push_back({part.triangles, part.lower, part.upper});
  child_begin_.assign(size_t{parts} + 3, 0);
  for (uint32_t part = parts; part-- > 0;) {
    const uint32_t parent = parts_[part].parent;
    ++child_begin_[parent + 1 + 2];
    if (parent == kNone) continue;
    totals_[parent].triangles += totals_[part].triangles;
    totals_[parent].lower = glm::min(totals_[parent].lower, totals_[part].lower);
    totals_[parent].upper = glm::max(totals_[parent].upper, totals_[part].upper);
  }
  // Counts become the places of the first children, which then move to the places behind the last.
  for (size_t i = 1; i < child_begin_.size(); ++i) child_begin_[i] += child_begin_[i - 1];
  children_.resize(parts);
  for (uint32_t part = 0; part < parts; ++part) children_[child_begin_[parts_[part].parent + 1 + 1]++] = part;
  heads_.assign(std::bit_ceil(std::max(parts, 1u)), kNone);
  next_.resize(parts);
  for (uint32_t part = parts; part-- > 0;)
    next_[part] = std::exchange(heads_[ListOf(parts_[part].parent, name(part))], part);
}

uint64_t PartTree::memory_bytes() const {
  const auto of = [](const auto&... vectors) {
    return ((vectors.capacity() * sizeof(*vectors.data())) + ...);
  };
  return of(parts_, totals_, names_, name_begin_, child_begin_, children_, heads_, next_);
}

std::string PartTree::Path(uint32_t part) const {
  std::vector<uint32_t> way{part};
  while (parts_[way.back()].parent != kNone) way.push_back(parts_[way.back()].parent);
  std::string path;
  for (size_t i = way.size(); i-- > 0;) AppendToPath(name(way[i]), path, i + 1 == way.size());
  return path;
}

std::vector<uint32_t> PartTree::Children(uint32_t parent, uint32_t from, uint32_t count) const {
  const uint32_t all = child_count(parent), first = std::min(from, all);
  const auto begin = children_.begin() + child_begin_[parent + 1] + first;
  return {begin, begin + std::min(count, all - first)};
}

size_t PartTree::ListOf(uint32_t parent, std::string_view name) const {
  return XXH3_64bits_withSeed(name.data(), name.size(), parent) & (heads_.size() - 1);
}

/// The children of `parents` with this name.
std::vector<uint32_t> PartTree::Named(std::span<const uint32_t> parents, std::string_view wanted) const {
  std::vector<uint32_t> found;
  for (const uint32_t parent : parents)
    for (uint32_t part = heads_[ListOf(parent, wanted)]; part != kNone; part = next_[part])
      if (parts_[part].parent == parent && name(part) == wanted) found.push_back(part);
  return found;
}

std::vector<uint32_t> PartTree::Exactly(const std::vector<std::string>& names) const {
  std::vector<uint32_t> found{kNone};
  for (const std::string& name : names) found = Named(found, name);
  return found;
}

std::vector<uint32_t> PartTree::Matching(std::string_view text) const {
  const PathPattern pattern(text);
  std::vector<PathPattern::State> states(size());
  std::vector<uint32_t> found;
  for (uint32_t part = 0; part < size(); ++part) {
    const uint32_t parent = parts_[part].parent;
    states[part] =
        parent == kNone ? pattern.AfterRoot(name(part)) : pattern.AfterChild(states[parent], name(part));
    if (pattern.Matches(states[part])) found.push_back(part);
  }
  return found;
}

/// Marks the parts whose names contain `text`, which has no capitals.
void PartTree::FindNames(std::string_view text, std::vector<bool>& found) const {
  // A piece of the names in lower case, which stays in a cache.
  constexpr uint32_t kPieceBytes = 64 << 10;
  std::string piece;
  for (uint32_t first = 0, end; first < size(); first = end) {
    for (end = first + 1; end < size() && name_begin_[end + 1] - name_begin_[first] <= kPieceBytes;) ++end;
    const uint32_t begin = name_begin_[first];
    piece.resize(name_begin_[end] - begin);
    std::transform(names_.begin() + begin, names_.begin() + name_begin_[end], piece.begin(), Lower);
    const char* at = piece.data();
    const char* const last = at + piece.size();
    for (uint32_t part = first; part < end; ++part) {
      at = static_cast<const char*>(memmem(at, static_cast<size_t>(last - at), text.data(), text.size()));
      if (!at) break;
      const auto place = begin + static_cast<uint32_t>(at - piece.data());
      while (name_begin_[part + 1] <= place) ++part;
      found[part] = true;
      at = piece.data() + (name_begin_[part + 1] - begin);
    }
  }
}

/// Whether a piece of a path, as lowered names, ends within the name of `part`: at a start of it.
bool PartTree::EndsHere(uint32_t part, const std::vector<std::string>& names) const {
  if (!Begins(name(part), names.back())) return false;
  for (size_t i = names.size() - 1; i-- > 0;) {
    part = parts_[part].parent;
    if (part == kNone || !Ends(name(part), names[i])) return false;
    if (i > 0 && name(part).size() != names[i].size()) return false;
  }
  return true;
}

/// Marks the parts whose paths contain a piece that is given as lowered names: where it ends, and all below.
void PartTree::FindPaths(const std::vector<std::string>& names, std::vector<bool>& found) const {
  for (uint32_t part = 0; part < size(); ++part) {
    const uint32_t parent = parts_[part].parent;
    found[part] = (parent != kNone && found[parent]) || EndsHere(part, names);
  }
}

PartTree::Found PartTree::Find(std::string_view text, uint32_t from, uint32_t count) const {
  std::vector<bool> marked(size());
  if (text.find('\0') != std::string_view::npos) return {};  // names end with it
  const std::string lower = Lowered(text);
  const std::vector<std::string> names = NamesOfPath(lower);
  if (names.size() > 1) {
    FindPaths(names, marked);
  } else {
    FindNames(text.find('/') == std::string_view::npos ? lower : names[0], marked);
  }
  Found found;
  for (uint32_t part = 0; part < size(); ++part) {
    if (!marked[part]) continue;
    if (found.total >= from && found.parts.size() < count) found.parts.push_back(part);
    ++found.total;
  }
  return found;
}

/// The child whose name is nearest to `name`, the first of several; kNone without children.
uint32_t PartTree::NearestChild(uint32_t parent, std::string_view wanted) const {
  const NameDistance distance(wanted);
  uint32_t nearest = kNone, least = std::numeric_limits<uint32_t>::max();
  for (uint32_t i = child_begin_[parent + 1]; i < child_begin_[parent + 2]; ++i) {
    const uint32_t edits = distance.To(name(children_[i]));
    if (edits >= least) continue;
    least = edits;
    nearest = children_[i];
  }
  return nearest;
}

/// The error for a path, which names no part. The nearest path is found name by name from the root on.
Error PartTree::NamesNothing(const std::string& path) const {
  uint32_t nearest = kNone;
  for (const std::string& wanted : NamesOfPath(path)) {
    const std::vector<uint32_t> exact = Named(std::span(&nearest, 1), wanted);
    const uint32_t child = exact.empty() ? NearestChild(nearest, wanted) : exact[0];
    if (child == kNone) break;
    nearest = child;
  }
  std::string sentence = fmt::format("no part is named {}", Quoted(path));
  sentence += nearest == kNone ? ": the store has no parts"
                               : fmt::format("; the nearest is {}", Quoted(Path(nearest)));
  return {std::move(sentence), ErrorKind::kUsage};
}

Result<std::vector<uint64_t>> PartTree::Resolve(std::span<const std::string> paths) const {
  constexpr uint32_t kBits = 64;
  std::vector<uint64_t> bits((size_t{size()} + kBits - 1) / kBits);
  size_t patterns = 0;
  for (const std::string& path : paths) {
    const bool star = HasStar(path);
    if (star && ++patterns > kMostPatterns)
      return BadUsage(
          fmt::format("more than {} paths have a *: name parts, or their parents", kMostPatterns));
    const std::vector<uint32_t> named = star ? Matching(path) : Exactly(NamesOfPath(path));
    if (named.empty()) return tl::unexpected<Error>(NamesNothing(path));
    for (const uint32_t part : named) bits[part / kBits] |= uint64_t{1} << part % kBits;
  }
  for (uint32_t part = 0; part < size(); ++part) {
    const uint32_t parent = parts_[part].parent;
    if (parent != kNone) bits[part / kBits] |= (bits[parent / kBits] >> parent % kBits & 1) << part % kBits;
  }
  return bits;
}

}  // namespace quarry
