#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// Reads an accessor of a glTF document from first element to last, through a buffer of bounded size.
/// Normalised integers become fractions; sparse elements are substituted. Thread safety: none.
class GltfAccessor {
 public:
  static constexpr uint32_t kMostComponents = 16;  ///< a matrix, column by column
  /// Errors, with the accessor's name: its type is not allowed; components other than `least` to `most`;
  /// elements beyond the buffer view; a stride too small.
  static Result<GltfAccessor> Open(GltfDocument& document, uint64_t index, uint32_t least, uint32_t most);

  /// Reads whole numbers of 32 bits that stand in the decoded bytes from `offset` on.
  static GltfAccessor OfDecoded(GltfDocument& document, uint64_t offset, uint64_t count);

  uint64_t count() const { return count_; }
  uint32_t components() const { return components_; }
  bool is_real() const;
  /// The next element's components. Requires: fewer than count() elements were read. Errors: read errors.
  Status Next(double (&values)[kMostComponents]);

 private:
  /// Elements in a buffer view.
  struct Place {
    uint64_t buffer = 0, begin = 0, stride = 0;
    bool nothing = false;  ///< no buffer view: all elements are zero
  };
  GltfAccessor(GltfDocument& document, uint64_t index) : document_(&document), index_(index) {}
  Status Load(const nlohmann::json& json);
  Status TakeElements(const GltfElements& elements);
  Status CountZeros(const nlohmann::json& json);
  Status LoadSparse(const nlohmann::json& json);
  Result<Place> FindPlace(const nlohmann::json& json, uint64_t count, uint32_t size);
  Result<std::vector<std::byte>> ReadAll(const Place& place, uint64_t count, uint32_t size);
  double Component(const std::byte* at) const;
  Result<uint64_t> Unsigned(const nlohmann::json& json, const char* key,
                            std::optional<uint64_t> fallback = std::nullopt) const;
  tl::unexpected<Error> FailAt(const std::string& what) const;

  GltfDocument* document_;
  uint64_t index_;
  uint64_t count_ = 0;
  uint32_t components_ = 0, component_type_ = 0, element_bytes_ = 0;
  bool normalized_ = false;
  Place place_;
  uint64_t next_ = 0, chunk_begin_ = 0, chunk_end_ = 0;  ///< element indices
  std::vector<std::byte> chunk_;
  std::vector<uint32_t> sparse_indices_;  ///< ascending
  std::vector<std::byte> sparse_values_;
  size_t next_sparse_ = 0;
};

}  // namespace quarry
