#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "preprocess/import/model_reader.h"

namespace quarry {

/// A glTF 2.0 or GLB file: its JSON in memory, its buffers where they lie. Not thread-safe.
class GltfDocument {
 public:
  /// JSON of more than this, and buffers inside it of more together, are refused.
  static constexpr uint64_t kMostJsonBytes = 256u << 20;

  /// Errors: no glTF 2.0, damaged JSON (where), a chunk that goes beyond the file; a file that is packed or
  /// comes from standard input, since buffers are read in any order.
  static Result<GltfDocument> Open(ModelReader& bytes);
  GltfDocument(GltfDocument&&) noexcept;
  ~GltfDocument();

  const std::string& path() const { return path_; }
  const nlohmann::json& json() const { return *json_; }
  /// "PATH: " + `what`.
  tl::unexpected<Error> FailAt(const std::string& what) const;
  /// Element `index` of the top-level array `array`. Errors: it is not there.
  Result<const nlohmann::json*> Find(const char* array, uint64_t index) const;

  /// Member `key` of `object`, which is called `where`, as a whole number; `fallback` where there is none.
  /// Errors: it is missing, of another type, negative, a fraction.
  Result<uint64_t> Unsigned(const nlohmann::json& object, const std::string& where, const char* key,
                            std::optional<uint64_t> fallback = std::nullopt) const;

  /// Fills `out` from byte `offset` of a buffer. Errors: no such buffer, its file cannot be read, or it has
  /// fewer bytes.
  Status ReadBuffer(uint64_t buffer, uint64_t offset, std::span<std::byte> out);

  /// Whether anything says where the bytes of a buffer are.
  bool HasBytes(uint64_t buffer) const;

  /// Bytes of a buffer: where in which file they are, or themselves (valid until another buffer is opened) if
  /// the JSON holds them.
  struct Range {
    std::string file;
    uint64_t offset = 0;
    std::span<const std::byte> content;
  };
  Result<Range> RangeOf(uint64_t buffer, uint64_t offset, uint64_t size);

  /// Which files the buffers lie in, and what they are like: another text when one has changed.
  std::string BufferFiles() const;

  /// The file that `uri` names, by the model's folder: decoded, or as it is written where that alone is
  /// there.
  std::string FileNameOf(const std::string& uri) const;

  /// What a data: URI holds; `where` names it. Errors: it is damaged; too many bytes in all such URIs.
  Result<Bytes> ReadDataUri(const std::string& uri, const std::string& where);

 private:
  /// Where the bytes of a buffer are.
  struct Buffer {
    std::optional<InputFile> file;  ///< else in `bytes`
    uint64_t begin = 0, size = 0;
    Bytes bytes;
  };
  GltfDocument(std::string path, std::unique_ptr<nlohmann::json> json);
  Result<Buffer> OpenBuffer(uint64_t index);
  /// The buffer, opened. Errors: also that it ends before byte `offset` + `size`.
  Result<const Buffer*> Reach(uint64_t index, uint64_t offset, uint64_t size);

  std::string path_;
  std::unique_ptr<nlohmann::json> json_;
  uint64_t glb_begin_ = 0, glb_size_ = 0;  ///< the GLB's binary chunk
  uint64_t inline_bytes_ = 0;
  std::vector<std::optional<Buffer>> buffers_;  ///< those opened so far
};

/// "%20" and the like, as URIs have them.
std::string PercentDecoded(std::string_view uri);

}  // namespace quarry
