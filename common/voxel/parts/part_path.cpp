#include "common/voxel/parts/part_path.h"

#include <algorithm>

namespace quarry {
namespace {

constexpr uint32_t kMostLetters = 64;

}  // namespace

void AppendToPath(std::string_view name, std::string& path, bool root) {
  if (!root) path += '/';
  for (const char c : name) {
    if (c == '\\' || c == '/' || c == '*') path += '\\';
    path += c;
  }
}

std::vector<std::string> NamesOfPath(std::string_view path) {
  std::vector<std::string> names(1);
  for (size_t i = 0; i < path.size(); ++i) {
    if (path[i] == '/') {
      names.emplace_back();
      continue;
    }
    if (path[i] == '\\' && i + 1 < path.size()) ++i;
    names.back() += path[i];
  }
  return names;
}

bool HasStar(std::string_view path) {
  for (size_t i = 0; i < path.size(); ++i) {
    if (path[i] == '*') return true;
    i += path[i] == '\\';
  }
  return false;
}

std::vector<uint16_t> PathPattern::Tokens(std::string_view pattern) {
  std::vector<uint16_t> tokens;
  for (size_t i = 0; i < pattern.size(); ++i) {
    const bool escaped = pattern[i] == '\\' && i + 1 < pattern.size();
    i += escaped;
    const char c = pattern[i];
    tokens.push_back(!escaped && c == '/'   ? kSlash
                     : !escaped && c == '*' ? kStar
                                            : static_cast<unsigned char>(c));
  }
  return tokens;
}

PathPattern::PathPattern(std::string_view pattern) {
  const std::vector<uint16_t> tokens = Tokens(pattern);
  std::span<const uint16_t> rest(tokens);
  for (bool searched = false;; searched = true) {
    const auto star = std::ranges::find(rest, kStar);
    const auto length = static_cast<size_t>(star - rest.begin());
    AddPiece(rest.first(length), searched, star == rest.end());
    if (star == rest.end()) return;
    rest = rest.subspan(length + 1);
  }
}

void PathPattern::AddPiece(std::span<const uint16_t> piece, bool searched, bool last) {
  const auto first = static_cast<State>(places_.size());
  State other = kLost;
  for (size_t i = 0; i < piece.size() + (last ? 1 : 0); ++i) {
    const uint16_t token = i < piece.size() ? piece[i] : kEnd;
    places_.push_back({token, searched ? other : kLost, searched && i == 0});
    // The longest start of the piece that ends here, for the next place.
    other = i == 0 ? first : Step(other, token);
  }
}

PathPattern::State PathPattern::Step(State state, uint16_t token) const {
  while (state != kLost) {
    const Place& place = places_[state];
    if (place.token == token) return state + 1;
    if (place.searched) return state;
    state = place.other;
  }
  return kLost;
}

PathPattern::State PathPattern::AfterName(State state, std::string_view name) const {
  for (const char c : name) {
    if (state == kLost) break;
    state = Step(state, static_cast<unsigned char>(c));
  }
  return state;
}

NameDistance::NameDistance(std::string_view name)
    : length_(static_cast<uint32_t>(std::min<size_t>(name.size(), kMostLetters))) {
  for (uint32_t i = 0; i < length_; ++i) places_[static_cast<unsigned char>(name[i])] |= uint64_t{1} << i;
}

uint32_t NameDistance::To(std::string_view other) const {
  other = other.substr(0, kMostLetters);
  if (length_ == 0) return static_cast<uint32_t>(other.size());
  const uint64_t last = uint64_t{1} << (length_ - 1);
  uint64_t more = ~uint64_t{0}, less = 0;  // where a column of the table rises, and falls, by one
  uint32_t distance = length_;
  for (const char c : other) {
    const uint64_t equal = places_[static_cast<unsigned char>(c)], x = equal | less;
    const uint64_t d = (((equal & more) + more) ^ more) | equal;
    const uint64_t up = less | ~(d | more), down = more & d;
    distance += (up & last) != 0;
    distance -= (down & last) != 0;
    more = down << 1 | ~(x | up << 1 | 1);
    less = (up << 1 | 1) & x;
  }
  return distance;
}

}  // namespace quarry
