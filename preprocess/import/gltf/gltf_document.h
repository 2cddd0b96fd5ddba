#pragma once

#include <cstdint>
#include <filesystem>
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
#include "preprocess/import/gltf/gltf_decoded.h"
#include "preprocess/import/model_reader.h"

namespace quarry {

/// Modes of a primitive that has triangles, as glTF numbers them.
struct GltfMode {
  static constexpr uint64_t kTriangles = 4, kStrip = 5, kFan = 6;
};

/// A glTF 2.0 or GLB file: its JSON in memory, its buffers in their files. Thread safety: none.
class GltfDocument {
 public:
  /// Limits: bytes of JSON; bytes of all buffers that the JSON holds.
  static constexpr uint64_t kMostJsonBytes = 256u << 20;

  /// Elements of accessors that stand in no buffer, over all uses of accessors.
  static constexpr uint64_t kMostZeros = 1u << 24;

  /// The number of the decoded bytes, for ReadBuffer(); no buffer of a document has it.
  static constexpr uint64_t kDecoded = ~uint64_t{0};

  /// Errors: no glTF 2.0; damaged JSON (with the place); a chunk beyond the file's end; a packed file or
  /// standard input, since buffers are read in any order.
  static Result<GltfDocument> Open(ModelReader& bytes, GltfDecoding decoding);
  GltfDocument(GltfDocument&&) noexcept;
  ~GltfDocument();

  const std::string& path() const { return path_; }
  const nlohmann::json& json() const { return *json_; }
  /// "PATH: " + `what`.
  tl::unexpected<Error> FailAt(const std::string& what) const;
  /// Element `index` of the top-level array `array`. Errors: there is none.
  Result<const nlohmann::json*> Find(const char* array, uint64_t index) const;

  /// Member `key` of `object` as a whole number, or `fallback` if it is absent. `where` names the object in
  /// errors. Errors: missing, of another type, negative, a fraction.
  Result<uint64_t> Unsigned(const nlohmann::json& object, const std::string& where, const char* key,
                            std::optional<uint64_t> fallback = std::nullopt) const;

  /// Fills `out` from byte `offset` of a buffer. Errors: no such buffer; its file cannot be read; too few
  /// bytes.
  Status ReadBuffer(uint64_t buffer, uint64_t offset, std::span<std::byte> out);

  /// The decoded bytes of the document's compressed parts.
  GltfDecoded& decoded() { return decoded_; }

  /// Whether the document names the place of the buffer's bytes.
  bool HasBytes(uint64_t buffer) const;

  /// Counts elements that stand in no buffer. Returns: false when they are more than kMostZeros with all
  /// before.
  bool TakeZeros(uint64_t count) {
    if (count > kMostZeros - zeros_) return false;
    zeros_ += count;
    return true;
  }

  /// Bytes of a buffer: a place in a file, or the bytes themselves if the JSON holds them (valid until
  /// another buffer is opened).
  struct Range {
    std::string file;
    uint64_t offset = 0;
    std::span<const std::byte> content;
  };
  Result<Range> RangeOf(uint64_t buffer, uint64_t offset, uint64_t size);

  /// The file that `uri` names, relative to the model's folder: decoded, or as written if only that file
  /// exists.
  std::string FileNameOf(const std::string& uri) const;

  /// The path of the file `name`, beside the model or beside the file that the model is a symbolic link to.
  std::filesystem::path PathOf(const std::string& name) const;

  /// The bytes of a data: URI; `where` names it in errors. Errors: damaged; too many bytes in all data: URIs
  /// together.
  Result<Bytes> ReadDataUri(const std::string& uri, const std::string& where);

 private:
  /// The place of a buffer's bytes.
  struct Buffer {
    std::optional<InputFile> file;  ///< absent: `bytes`
    uint64_t begin = 0, size = 0;
    Bytes bytes;
  };
  GltfDocument(std::string path, std::unique_ptr<nlohmann::json> json, GltfDecoding decoding);
  Result<Buffer> OpenBuffer(uint64_t index);
  /// Opens the buffer. Errors: also if it ends before byte `offset` + `size`.
  Result<const Buffer*> Reach(uint64_t index, uint64_t offset, uint64_t size);

  std::string path_;
  std::unique_ptr<nlohmann::json> json_;
  GltfDecoded decoded_;
  uint64_t glb_begin_ = 0, glb_size_ = 0;  ///< the GLB's binary chunk, in bytes
  uint64_t inline_bytes_ = 0, zeros_ = 0;
  std::vector<std::optional<Buffer>> buffers_;  ///< opened so far
};

/// Decodes "%20" and the like in a URI.
std::string PercentDecoded(std::string_view uri);

}  // namespace quarry
