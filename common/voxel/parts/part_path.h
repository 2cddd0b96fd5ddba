#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace quarry {

// The path of a part is the names from the root to it, joined by '/'. In a name, '\', '/' and '*' are written
// "\\", "\/" and "\*". In a path that selects parts, a '*' without a backslash stands for any characters, '/'
// too.

/// Appends a part's name to the path of its parent; a root's to an empty path.
void AppendToPath(std::string_view name, std::string& path, bool root);

/// The names of a path, without backslashes. A backslash before another character is left out too.
std::vector<std::string> NamesOfPath(std::string_view path);
/// Whether a path has a '*' without a backslash.
bool HasStar(std::string_view path);

/// A path with stars, compared with many paths by their names from the root on. The way of a path through the
/// pattern is a state, so that a child's path goes on where its parent's ended. Unchanged after the
/// constructor; thread-safe.
/// Source: each piece between two stars is found by Knuth, Morris and Pratt's automaton; the first match of
/// every piece but the last suffices, and the last piece must end the path.
class PathPattern {
 public:
  using State = uint32_t;
  explicit PathPattern(std::string_view pattern);

  /// The state after the path of a root with this name.
  State AfterRoot(std::string_view name) const { return AfterName(0, name); }
  /// The state after the path of a part with this name, from the state after its parent's.
  State AfterChild(State parent, std::string_view name) const {
    return AfterName(Step(parent, kSlash), name);
  }
  bool Matches(State state) const { return state + 1 == places_.size(); }

 private:
  static constexpr uint16_t kSlash = 256, kStar = 257, kEnd = 258;
  static constexpr State kLost = 0xFFFFFFFFu;
  struct Place {
    uint16_t token = kEnd;  ///< leads to the next place
    State other = kLost;    ///< the place to look at for other tokens; kLost: the path does not match
    bool searched = false;  ///< the first place of a piece after a star: other tokens stay here
  };
  static std::vector<uint16_t> Tokens(std::string_view pattern);
  void AddPiece(std::span<const uint16_t> piece, bool searched, bool last);
  State Step(State state, uint16_t token) const;
  State AfterName(State state, std::string_view name) const;

  std::vector<Place> places_;  ///< piece after piece, and the end
};

/// The edits (a letter more, less or changed) that turn a fixed name into others. Of names, the first 64
/// bytes count. Unchanged after the constructor; thread-safe. Source: Myers 1999, in the form of Hyyrö 2003.
class NameDistance {
 public:
  explicit NameDistance(std::string_view name);
  uint32_t To(std::string_view other) const;

 private:
  uint64_t places_[256] = {};  ///< of each byte: its places in the name
  uint32_t length_ = 0;
};

}  // namespace quarry
