#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/spill/paged_file.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

constexpr uint32_t kWhite = 0xFFFFFFFFu;  ///< a packed colour that changes nothing

/// A triangle whose corners are still indices into the vertex streams of its file.
struct Face {
  Corner corners[3];
  uint32_t id = 0;
  uint16_t material = 0;
  uint16_t smoothing = 0;
  uint32_t part = 0;
  uint32_t color = kWhite;  ///< replaces its corners' colours unless white
  uint32_t following = 0;   ///< triangles of the same polygon's fan that come after
};

/// The positions (with colours), normals and texture coordinates of one model file: all on disk, the pages
/// used last in memory. Memory: three times PagedFile's. Thread safety: several
/// threads may call Find() at once; nothing else.
class VertexStreams {
 public:
  /// Creates or empties the files "FOLDER/import-STREAM". Errors: as PagedFile's.
  static Result<VertexStreams> Open(const std::string& folder);

  /// Each appends an element with the stream's next index. Errors: disk full.
  Status AddPosition(const glm::vec3& position, uint32_t color) {
    const StoredPosition stored{position, color};
    return positions_.Append(&stored);
  }
  Status AddNormal(const glm::vec3& normal) { return normals_.Append(&normal); }
  Status AddUv(const glm::vec2& uv) { return uvs_.Append(&uv); }

  uint64_t positions() const { return positions_.count(); }
  uint64_t normals() const { return normals_.count(); }
  uint64_t uvs() const { return uvs_.count(); }
  /// Whether all elements that the face's corners name have been added.
  bool Has(const Face& face) const;

  /// Fills in `record` from the pages in memory. False: an element is not in memory, or not added yet; the
  /// record is filled in part then.
  bool Find(const Face& face, TriangleRecord& record);
  /// Loads pages of the face's corners, each load taken off `loads`, until that is zero.
  Status Load(const Face& face, uint32_t& loads);

  /// Ends appending and frees the pages. Windows may be loaded afterwards.
  Status FinishWriting();
  std::vector<SpillFile*> Files() { return {&positions_.file(), &normals_.file(), &uvs_.file()}; }

 private:
  friend class VertexWindow;
  struct StoredPosition {
    glm::vec3 position;
    uint32_t color;
  };
  VertexStreams(PagedFile positions, PagedFile normals, PagedFile uvs)
      : positions_(std::move(positions)), normals_(std::move(normals)), uvs_(std::move(uvs)) {}

  PagedFile positions_, normals_, uvs_;
};

/// The elements [first, first + count) of all three streams, in memory.
class VertexWindow {
 public:
  /// Elements of each stream that `bytes` hold, at least 1,024.
  static uint64_t CountFor(uint64_t bytes);

  /// Requires: FinishWriting() of the streams. Errors: read errors.
  Status Load(const VertexStreams& streams, uint64_t first, uint64_t count);
  /// Fills in the elements of the face that lie in the window, and leaves the others.
  void FillIn(const Face& face, TriangleRecord& record) const;

 private:
  struct Stretch {
    uint64_t first = 0, count = 0;
    std::vector<std::byte> bytes;
    Status Load(const SpillFile& file, uint64_t from, uint64_t window);
    template <class T>
    bool Find(uint32_t index, T& value) const;
  };
  Stretch positions_, normals_, uvs_;
};

}  // namespace quarry
