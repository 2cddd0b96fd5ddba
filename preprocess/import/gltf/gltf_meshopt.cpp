#include "preprocess/import/gltf/gltf_meshopt.h"

#include <fmt/format.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "common/base/bytes.h"
#include "preprocess/import/gltf/gltf_material.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr const char* kMeshopt = "EXT_meshopt_compression";

enum class MeshoptMode { kAttributes, kTriangles, kIndices };

/// A compressed stream: its place and the form of its contents.
struct Stream {
  uint64_t buffer = 0, offset = 0, length = 0;  ///< bytes
  uint64_t count = 0, stride = 0;               ///< elements, bytes of each
  MeshoptMode mode = MeshoptMode::kAttributes;
  std::string filter;
  uint64_t decoded() const { return count * stride; }
};

/// The upper half of a stream's first byte; the lower half is the codec's version.
unsigned MagicOf(MeshoptMode mode) {
  return mode == MeshoptMode::kAttributes ? 0xA0u : mode == MeshoptMode::kTriangles ? 0xE0u : 0xD0u;
}

/// The most elements that a sound stream of so many bytes holds. Of attributes, a block of 256 elements of n
/// bytes takes 4 n bytes or more; a triangle and an index take a byte or more.
uint64_t MostElements(const Stream& stream) {
  switch (stream.mode) {
    case MeshoptMode::kAttributes:
      return stream.length * 64 / stream.stride;
    case MeshoptMode::kTriangles:
      return stream.length * 3;
    default:
      return stream.length;
  }
}

/// Why the extension does not allow these parameters; empty: it does.
std::string Fault(const Stream& stream) {
  const uint64_t stride = stream.stride;
  if (stream.mode != MeshoptMode::kAttributes) {
    if (stride != 2 && stride != 4) return fmt::format("a byteStride of {} for indices", stride);
    if (stream.filter != "NONE") return "a filter for indices";
    if (stream.mode == MeshoptMode::kTriangles && stream.count % 3 != 0)
      return fmt::format("{} indices, which are not whole triangles", stream.count);
    return {};
  }
  if (stride == 0 || stride > 256 || stride % 4 != 0)
    return fmt::format("a byteStride of {}, which is not a multiple of 4 up to 256", stride);
  const bool known = stream.filter == "NONE" || stream.filter == "EXPONENTIAL" ||
                     stream.filter == "OCTAHEDRAL" || stream.filter == "QUATERNION";
  if (!known) return fmt::format("the filter {}, which is unknown", Quoted(stream.filter));
  if ((stream.filter == "OCTAHEDRAL" && stride != 4 && stride != 8) ||
      (stream.filter == "QUATERNION" && stride != 8))
    return fmt::format("a byteStride of {} for the filter {}", stride, stream.filter);
  return {};
}

/// Returns meshoptimizer's code: 0 if all went well.
int Decode(const Stream& stream, std::span<const std::byte> from, std::span<std::byte> to) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(from.data());
  switch (stream.mode) {
    case MeshoptMode::kAttributes:
      return meshopt_decodeVertexBuffer(to.data(), stream.count, stream.stride, bytes, from.size());
    case MeshoptMode::kTriangles:
      return meshopt_decodeIndexBuffer(to.data(), stream.count, stream.stride, bytes, from.size());
    default:
      return meshopt_decodeIndexSequence(to.data(), stream.count, stream.stride, bytes, from.size());
  }
}

void Unfilter(const Stream& stream, std::span<std::byte> bytes) {
  if (stream.filter == "OCTAHEDRAL") meshopt_decodeFilterOct(bytes.data(), stream.count, stream.stride);
  if (stream.filter == "QUATERNION") meshopt_decodeFilterQuat(bytes.data(), stream.count, stream.stride);
  if (stream.filter == "EXPONENTIAL") meshopt_decodeFilterExp(bytes.data(), stream.count, stream.stride);
}

class MeshoptView {
 public:
  MeshoptView(GltfDocument& document, uint64_t index)
      : document_(document), name_(fmt::format("bufferViews[{}].extensions.{}", index, kMeshopt)) {}

  Result<uint64_t> Decode(const Json& view, const Json& extension) {
    QUARRY_ASSIGN(const Stream stream, Read(extension));
    QUARRY_ASSIGN(const uint64_t length, document_.Unsigned(view, name_, "byteLength"));
    if (length > stream.decoded())
      return FailAt(fmt::format("its {} elements of {} bytes are fewer than the view's {} bytes",
                                stream.count, stream.stride, length));
    // The compressed bytes are held beside the decoded ones.
    const uint64_t needed = stream.length + stream.decoded(),
                   most = document_.decoded().decoding().memory / 2;
    if (needed > most)
      return FailAt(
          fmt::format("takes {} MiB to decode, more than half of --memory; give more, or export the "
                      "model without the extension",
                      (needed >> 20) + 1));
    Bytes from(stream.length), to(stream.decoded());
    QUARRY_TRY(document_.ReadBuffer(stream.buffer, stream.offset, from));
    QUARRY_TRY(Decode(stream, from, to));
    auto offset = document_.decoded().Append(to);
    if (!offset) return FailAt(offset.error().message);
    return offset;
  }

 private:
  tl::unexpected<Error> FailAt(const std::string& what) const {
    return document_.FailAt(fmt::format("{}: {}", name_, what));
  }

  /// The parameters, checked against each other and against the file.
  Result<Stream> Read(const Json& extension) {
    Stream stream;
    QUARRY_ASSIGN(stream.buffer, document_.Unsigned(extension, name_, "buffer"));
    QUARRY_ASSIGN(stream.offset, document_.Unsigned(extension, name_, "byteOffset", 0));
    QUARRY_ASSIGN(stream.length, document_.Unsigned(extension, name_, "byteLength"));
    QUARRY_ASSIGN(stream.stride, document_.Unsigned(extension, name_, "byteStride"));
    QUARRY_ASSIGN(stream.count, document_.Unsigned(extension, name_, "count"));
    const std::string mode = extension.value("mode", "");
    if (mode != "ATTRIBUTES" && mode != "TRIANGLES" && mode != "INDICES")
      return FailAt(fmt::format("the mode {} is unknown", Quoted(mode)));
    stream.mode = mode == "ATTRIBUTES"  ? MeshoptMode::kAttributes
                  : mode == "TRIANGLES" ? MeshoptMode::kTriangles
                                        : MeshoptMode::kIndices;
    stream.filter = extension.value("filter", "NONE");
    if (const std::string fault = Fault(stream); !fault.empty()) return FailAt("has " + fault);
    // Errors: the bytes are not all there.
    QUARRY_TRY(document_.RangeOf(stream.buffer, stream.offset, stream.length));
    if (stream.count > MostElements(stream))
      return FailAt(fmt::format("{} elements of {} bytes cannot be decoded from {} bytes", stream.count,
                                stream.stride, stream.length));
    return stream;
  }

  Status Decode(const Stream& stream, std::span<const std::byte> from, std::span<std::byte> to) const {
    if (stream.count == 0) return {};
    const int code = quarry::Decode(stream, from, to);
    if (code == 0) {
      Unfilter(stream, to);
      return {};
    }
    const unsigned first = from.empty() ? 0 : std::to_integer<unsigned>(from[0]);
    constexpr unsigned kVersion = 0x0F;
    if (code == -1 && (first & ~kVersion) == MagicOf(stream.mode))
      return FailAt(
          fmt::format("is of version {} of the codec, which is not read; export the model with {} or "
                      "without compression",
                      first & kVersion, kMeshopt));
    return FailAt("its bytes are damaged; export the model again");
  }

  GltfDocument& document_;
  std::string name_;
};

}  // namespace

Result<std::optional<uint64_t>> DecodeMeshoptView(GltfDocument& document, uint64_t index, const Json& view) {
  const Json& extensions = Member(view, "extensions");
  if (!extensions.contains(kMeshopt)) return std::optional<uint64_t>();
  if (const auto decoded = document.decoded().FindView(index)) return decoded;
  QUARRY_ASSIGN(const uint64_t offset,
                MeshoptView(document, index).Decode(view, Member(extensions, kMeshopt)));
  document.decoded().NoteView(index, offset);
  return std::optional(offset);
}

}  // namespace quarry
