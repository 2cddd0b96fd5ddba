#include "preprocess/import/gltf/gltf_accessor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "preprocess/import/gltf/gltf_extensions.h"
#include "preprocess/import/gltf/gltf_meshopt.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kChunkBytes = 1u << 18;
constexpr uint64_t kMostSparse = 1u << 24;  // elements; they are held in memory
// Zeros that each sparse element may bring; more count (GltfDocument::TakeZeros())
constexpr uint64_t kZerosASparse = 256;
enum ComponentType : uint32_t { kByte = 5120, kUbyte, kShort, kUshort, kUint = 5125, kFloat };

uint32_t SizeOf(uint64_t type) {
  switch (type) {
    case kByte:
    case kUbyte:
      return 1;
    case kShort:
    case kUshort:
      return 2;
    case kUint:
    case kFloat:
      return 4;
    default:
      return 0;
  }
}

uint32_t ComponentsOf(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "MAT4") return GltfAccessor::kMostComponents;
  return type == "VEC4" ? 4 : 0;
}

template <class T>
double As(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  return static_cast<double>(value);
}

}  // namespace

bool GltfAccessor::is_real() const { return component_type_ == kFloat; }

tl::unexpected<Error> GltfAccessor::FailAt(const std::string& what) const {
  return document_->FailAt(fmt::format("accessors[{}]: {}", index_, what));
}

Result<uint64_t> GltfAccessor::Unsigned(const Json& json, const char* key,
                                        std::optional<uint64_t> fallback) const {
  return document_->Unsigned(json, fmt::format("accessors[{}] (or a part of it)", index_), key, fallback);
}

Result<GltfAccessor> GltfAccessor::Open(GltfDocument& document, uint64_t index, uint32_t least,
                                        uint32_t most) {
  QUARRY_ASSIGN(const Json* json, document.Find("accessors", index));
  GltfAccessor accessor(document, index);
  QUARRY_TRY(accessor.Load(*json));
  if (accessor.components_ < least || accessor.components_ > most)
    return accessor.FailAt(
        fmt::format("has {} components, which does not fit its use", accessor.components_));
  return accessor;
}

GltfAccessor GltfAccessor::OfDecoded(GltfDocument& document, uint64_t offset, uint64_t count) {
  GltfAccessor accessor(document, 0);
  accessor.count_ = count;
  accessor.components_ = 1;
  accessor.component_type_ = kUint;
  accessor.element_bytes_ = sizeof(uint32_t);
  accessor.place_ = {GltfDocument::kDecoded, offset, sizeof(uint32_t)};
  return accessor;
}

/// Takes elements that were decoded with their mesh; the accessor's own place and count are ignored.
Status GltfAccessor::TakeElements(const GltfElements& elements) {
  if (elements.components != components_)
    return FailAt(
        fmt::format("has {} components, but its compressed attribute {}", components_, elements.components));
  normalized_ |= component_type_ == kFloat && elements.normalized;
  component_type_ = elements.component_type;
  element_bytes_ = components_ * SizeOf(component_type_);
  count_ = elements.count;
  place_ = {GltfDocument::kDecoded, elements.offset, element_bytes_};
  return {};
}

Status GltfAccessor::Load(const Json& json) {
  QUARRY_ASSIGN(const uint64_t component_type, Unsigned(json, "componentType"));
  if (SizeOf(component_type) == 0) return FailAt(fmt::format("componentType {} is unknown", component_type));
  component_type_ = static_cast<uint32_t>(component_type);
  components_ = ComponentsOf(json.value("type", ""));
  if (components_ == 0) return FailAt("its type is not SCALAR, VEC2, VEC3, VEC4 or MAT4");
  element_bytes_ = components_ * SizeOf(component_type);
  normalized_ = json.value("normalized", false);
  if (const GltfElements* elements = document_->decoded().FindElements(index_))
    return TakeElements(*elements);
  QUARRY_ASSIGN(count_, Unsigned(json, "count"));
  if (count_ > 0xFFFFFFFF) return FailAt(fmt::format("{} elements are more than 32 bits can count", count_));
  if (json.contains("bufferView")) {
    QUARRY_ASSIGN(place_, FindPlace(json, count_, element_bytes_));
  } else {
    place_.nothing = true;
    QUARRY_TRY(CountZeros(json));
  }
  if (json.contains("sparse")) return LoadSparse(json.at("sparse"));
  return {};
}

/// Counts elements that stand in no file: few bytes could ask for any number of them.
Status GltfAccessor::CountZeros(const Json& json) {
  uint64_t given = 0;
  if (json.contains("sparse")) {
    QUARRY_ASSIGN(given, Unsigned(json.at("sparse"), "count"));
  }
  const uint64_t free = std::min(given, kMostSparse) * kZerosASparse;
  if (count_ <= free || document_->TakeZeros(count_ - free)) return {};
  return FailAt(
      fmt::format("{} elements without a buffer view, only {} of them sparse: so many zeros are not read",
                  count_, given));
}

/// The place of `count` elements of `size` bytes that `json` names (bufferView, byteOffset).
Result<GltfAccessor::Place> GltfAccessor::FindPlace(const Json& json, uint64_t count, uint32_t size) {
  QUARRY_ASSIGN(const uint64_t view_index, Unsigned(json, "bufferView"));
  QUARRY_ASSIGN(const uint64_t offset, Unsigned(json, "byteOffset", 0));
  QUARRY_ASSIGN(const Json* view, document_->Find("bufferViews", view_index));
  Place place;
  uint64_t begin = 0;
  QUARRY_ASSIGN(const std::optional<uint64_t> decoded, DecodeMeshoptView(*document_, view_index, *view));
  if (decoded) {
    place.buffer = GltfDocument::kDecoded;
    begin = *decoded;
  } else {
    QUARRY_ASSIGN(place.buffer, Unsigned(*view, "buffer"));
    QUARRY_TRY(CheckNotCompressed(*document_, *view, fmt::format("bufferViews[{}]", view_index),
                                  document_->HasBytes(place.buffer)));
    QUARRY_ASSIGN(begin, Unsigned(*view, "byteOffset", 0));
  }
  QUARRY_ASSIGN(const uint64_t length, Unsigned(*view, "byteLength"));
  QUARRY_ASSIGN(place.stride, Unsigned(*view, "byteStride", size));
  if (place.stride < size || place.stride > 4096)
    return FailAt(fmt::format("a byteStride of {} for elements of {} bytes", place.stride, size));
  constexpr uint64_t kMost = uint64_t{1} << 48;
  if (begin > kMost || length > kMost || offset > length ||
      (count != 0 && (count - 1) * place.stride + size > length - offset))
    return FailAt(
        fmt::format("its {} elements go beyond bufferViews[{}] of {} bytes", count, view_index, length));
  place.begin = begin + offset;
  return place;
}

Result<std::vector<std::byte>> GltfAccessor::ReadAll(const Place& place, uint64_t count, uint32_t size) {
  std::vector<std::byte> bytes(count * size);
  if (count == 0) return bytes;
  std::vector<std::byte> spread((count - 1) * place.stride + size);
  QUARRY_TRY(document_->ReadBuffer(place.buffer, place.begin, spread));
  for (uint64_t i = 0; i < count; ++i) std::memcpy(&bytes[i * size], &spread[i * place.stride], size);
  return bytes;
}

Status GltfAccessor::LoadSparse(const Json& json) {
  QUARRY_ASSIGN(const uint64_t count, Unsigned(json, "count"));
  if (count > count_ || count > kMostSparse)
    return FailAt(fmt::format("{} sparse elements are too many", count));
  const Json& indices = json.at("indices");
  QUARRY_ASSIGN(const uint64_t type, Unsigned(indices, "componentType"));
  if (type != kUbyte && type != kUshort && type != kUint) return FailAt("sparse indices of an unknown type");
  const uint32_t size = SizeOf(type);
  QUARRY_ASSIGN(const Place index_place, FindPlace(indices, count, size));
  QUARRY_ASSIGN(const auto index_bytes, ReadAll(index_place, count, size));
  for (uint64_t i = 0; i < count; ++i) {
    uint32_t index = 0;
    std::memcpy(&index, &index_bytes[i * size], size);
    if (index >= count_ || (i != 0 && index <= sparse_indices_.back()))
      return FailAt("sparse indices do not rise, or go beyond the elements");
    sparse_indices_.push_back(index);
  }
  QUARRY_ASSIGN(const Place value_place, FindPlace(json.at("values"), count, element_bytes_));
  QUARRY_ASSIGN(sparse_values_, ReadAll(value_place, count, element_bytes_));
  return {};
}

double GltfAccessor::Component(const std::byte* at) const {
  switch (component_type_) {
    case kByte:
      return normalized_ ? std::max(As<int8_t>(at) / 127, -1.0) : As<int8_t>(at);
    case kUbyte:
      return normalized_ ? As<uint8_t>(at) / 255 : As<uint8_t>(at);
    case kShort:
      return normalized_ ? std::max(As<int16_t>(at) / 32767, -1.0) : As<int16_t>(at);
    case kUshort:
      return normalized_ ? As<uint16_t>(at) / 65535 : As<uint16_t>(at);
    case kUint:
      return As<uint32_t>(at);
    default:
      return As<float>(at);
  }
}

Status GltfAccessor::Next(double (&values)[kMostComponents]) {
  if (next_ == chunk_end_ && !place_.nothing) {
    const uint64_t elements = std::min(count_ - next_, std::max<uint64_t>(kChunkBytes / place_.stride, 1));
    chunk_.resize((elements - 1) * place_.stride + element_bytes_);
    QUARRY_TRY(document_->ReadBuffer(place_.buffer, place_.begin + next_ * place_.stride, chunk_));
    chunk_begin_ = next_;
    chunk_end_ = next_ + elements;
  }
  const std::byte* at = place_.nothing ? nullptr : chunk_.data() + (next_ - chunk_begin_) * place_.stride;
  if (next_sparse_ < sparse_indices_.size() && sparse_indices_[next_sparse_] == next_)
    at = sparse_values_.data() + next_sparse_++ * element_bytes_;
  for (uint32_t c = 0; c < components_; ++c) values[c] = at ? Component(at + c * SizeOf(component_type_)) : 0;
  ++next_;
  return {};
}

}  // namespace quarry
