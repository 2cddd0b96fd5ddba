#include "preprocess/import/gltf/gltf_document.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/json_file.h"
#include "preprocess/import/files/find_file.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/import/foreign/foreign_content.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

/// Nesting limit: nodes refer to each other by index, so only extensions nest deeply. Length limit: the
/// arrays of a large scene have millions of values.
constexpr JsonLimits kJsonLimits{GltfDocument::kMostJsonBytes, 128, 64u << 20, 1u << 20};
constexpr uint32_t kGlbMagic = 0x46546C67;     // "glTF"
constexpr uint32_t kJsonChunk = 0x4E4F534A;    // "JSON"
constexpr uint32_t kBinaryChunk = 0x004E4942;  // "BIN"

uint32_t Word(const ModelReader& bytes, size_t at) {
  uint32_t word;
  std::memcpy(&word, bytes.data() + at, sizeof word);
  return word;
}

/// Reads the next `size` bytes as text.
Result<std::string> TakeText(ModelReader& bytes, uint64_t size) {
  std::string text;
  while (text.size() < size) {
    if (!bytes.Ensure(1)) return bytes.Truncated("within its JSON");
    const size_t part = std::min<uint64_t>(size - text.size(), bytes.available());
    text.append(bytes.data(), part);
    bytes.Consume(part);
  }
  return text;
}

/// -1: `c` is no base64 digit.
int Base64Digit(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  return c == '+' || c == '-' ? 62 : c == '/' || c == '_' ? 63 : -1;
}

/// Treats members that are null as absent.
void DropNulls(Json& json) {
  if (json.is_object())
    for (auto it = json.begin(); it != json.end();) it = it->is_null() ? json.erase(it) : std::next(it);
  if (json.is_structured())
    for (Json& inner : json) DropNulls(inner);
}

/// Errors: a buffer's file is a pointer to a file or a web page, recognised by its small size and text.
Status CheckIsBuffer(const InputFile& file, const std::string& path) {
  constexpr uint64_t kLook = 1024;
  std::string text(std::min(file.size(), kLook), 0);
  if (text.size() < 8 || file.size() > kLook) return {};
  QUARRY_TRY(file.ReadAt(0, std::as_writable_bytes(std::span(text))));
  if (!std::all_of(text.begin(), text.begin() + 8, [](char c) { return c >= ' ' && c <= '~'; })) return {};
  const ForeignContent content = RecognizeForeign(text, ".bin");
  if (content.what.empty()) return {};
  return Fail(fmt::format("{} is {}; {}", path, content.what, content.advice));
}

std::optional<Bytes> DecodeBase64(std::string_view text) {
  Bytes out;
  out.reserve(text.size() / 4 * 3);
  uint32_t bits = 0, count = 0;
  for (const char c : text) {
    if (c == '=') break;
    const int digit = Base64Digit(c);
    if (digit < 0) return std::nullopt;
    bits = bits << 6 | static_cast<uint32_t>(digit);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    out.push_back(static_cast<std::byte>(bits >> count));
  }
  return out;
}

}  // namespace

std::string PercentDecoded(std::string_view uri) {
  const auto hex = [](char c) {
    return c >= '0' && c <= '9' ? c - '0' : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10 : -1;
  };
  std::string out;
  for (size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] == '%' && i + 2 < uri.size() && hex(uri[i + 1]) >= 0 && hex(uri[i + 2]) >= 0) {
      out.push_back(static_cast<char>(hex(uri[i + 1]) * 16 + hex(uri[i + 2])));
      i += 2;
    } else {
      out.push_back(uri[i]);
    }
  }
  return out;
}

GltfDocument::GltfDocument(std::string path, std::unique_ptr<Json> json, GltfDecoding decoding)
    : path_(std::move(path)), json_(std::move(json)), decoded_(std::move(decoding)) {}
GltfDocument::GltfDocument(GltfDocument&&) noexcept = default;
GltfDocument::~GltfDocument() = default;

tl::unexpected<Error> GltfDocument::FailAt(const std::string& what) const {
  return Fail(fmt::format("{}: {}", path_, what));
}

Result<GltfDocument> GltfDocument::Open(ModelReader& bytes, GltfDecoding decoding) {
  if (!bytes.has_size())
    return Fail(
        fmt::format("{}: glTF is read in any order; give it as a file that is not packed", bytes.path()));
  uint64_t json_bytes = bytes.size(), glb_begin = 0, glb_size = 0;
  if (bytes.Ensure(20) && Word(bytes, 0) == kGlbMagic) {
    if (Word(bytes, 4) != 2)
      return bytes.FailHere(fmt::format("GLB version {}; only version 2 is read", Word(bytes, 4)));
    json_bytes = Word(bytes, 12);
    if (Word(bytes, 16) != kJsonChunk) return bytes.FailHere("the first chunk of the GLB is not JSON");
    bytes.Consume(20);
    glb_begin = 20 + (json_bytes + 3) / 4 * 4 + 8;
  } else if (bytes.Ensure(4) && Word(bytes, 0) == kGlbMagic)
    return bytes.Truncated("within the header of the GLB");
  if (json_bytes > kMostJsonBytes || json_bytes > bytes.remaining())
    return bytes.FailHere(fmt::format("the JSON's {} bytes go beyond the file, or are too many", json_bytes));
  QUARRY_ASSIGN(std::string text, TakeText(bytes, json_bytes));
  if (glb_begin != 0) {
    text.erase(text.find_last_not_of('\0') + 1);  // some writers pad with zeros instead of spaces
    // The next chunk begins at a multiple of four; some writers do not pad.
    const uint64_t padding = glb_begin - 28 - json_bytes;
    if (padding != 0 && bytes.Ensure(8) && Word(bytes, 4) == kBinaryChunk)
      glb_begin -= padding;
    else
      bytes.Skip(std::min<uint64_t>(padding, bytes.remaining()));
    // Chunks of other kinds should follow, but some writers put them first.
    while (bytes.Ensure(8) && Word(bytes, 4) != kBinaryChunk) {
      const uint64_t other = 8 + (uint64_t{Word(bytes, 0)} + 3) / 4 * 4;
      if (!bytes.Skip(other)) break;
      glb_begin += other;
    }
    if (bytes.Ensure(8) && Word(bytes, 4) == kBinaryChunk) {
      glb_size = Word(bytes, 0);
      if (glb_size > bytes.size() - glb_begin)
        return bytes.FailHere(fmt::format("the binary chunk's {} bytes go beyond the file", glb_size));
    }
  }
  QUARRY_ASSIGN(Json json, ParseJson<Json>(text, bytes.path(), kJsonLimits));
  DropNulls(json);
  GltfDocument document(bytes.path(), std::make_unique<Json>(std::move(json)), std::move(decoding));
  document.glb_begin_ = glb_begin;
  document.glb_size_ = glb_size;
  constexpr const char* kOther = "holds JSON that is not glTF: {}; give the model itself";
  if (!document.json_->is_object()) return document.FailAt(fmt::format(kOther, "it is not an object"));
  const Json* asset = document.json_->contains("asset") ? &document.json_->at("asset") : nullptr;
  if (document.json_->contains("geometricError"))
    return document.FailAt("is a tileset of 3D Tiles; give the GLB files of its tiles");
  if (!asset || !asset->is_object()) return document.FailAt(fmt::format(kOther, "it has no asset.version"));
  const auto is_2 = [&](const char* key) {
    const auto version = asset->find(key);
    if (version == asset->end()) return false;
    return (version->is_string() ? version->get<std::string>() : version->dump()).starts_with("2");
  };
  if (asset->contains("minVersion") && !is_2("minVersion"))
    return document.FailAt("needs a version of glTF beyond 2 (asset.minVersion); export it as glTF 2");
  if (!is_2("version"))
    return document.FailAt(
        "is not glTF 2 (asset.version); convert it, with a program that reads it, to glTF 2");
  return document;
}

Result<const Json*> GltfDocument::Find(const char* array, uint64_t index) const {
  const auto it = json_->find(array);
  if (it == json_->end() || !it->is_array() || index >= it->size() || !(*it)[index].is_object())
    return FailAt(fmt::format("{}[{}] is not there", array, index));
  return &(*it)[index];
}

Result<GltfDocument::Buffer> GltfDocument::OpenBuffer(uint64_t index) {
  QUARRY_ASSIGN(const Json* json, Find("buffers", index));
  const auto named = [&](const std::string& what) {
    return FailAt(fmt::format("buffers[{}]: {}", index, what));
  };
  Buffer buffer;
  if (json->value("uri", "").empty()) {
    if (index != 0 || glb_size_ == 0) return named("has no uri, and the file no binary chunk for it");
    QUARRY_ASSIGN(buffer.file, InputFile::Open(path_));
    buffer.begin = glb_begin_;
    buffer.size = glb_size_;
    return buffer;
  }
  const auto uri = json->at("uri").get<std::string>();
  if (uri.starts_with("data:")) {
    QUARRY_ASSIGN(buffer.bytes, ReadDataUri(uri, fmt::format("buffers[{}]", index)));
    buffer.size = buffer.bytes.size();
    return buffer;
  }
  if (uri.find("://") != uri.npos)
    return named(
        fmt::format("{} is an address; download it beside the model, and name that file", Quoted(uri)));
  const std::string name = FileNameOf(uri);
  const std::filesystem::path file = PathOf(name);
  if (std::filesystem::path(name).is_absolute() || LeavesFolder(path_, file) ||
      name.find('\0') != std::string::npos)
    return named(
        fmt::format("the uri {} leads out of the model's folder, where buffers must lie", Quoted(name)));
  NoteModelFile(file.string());
  auto opened = InputFile::Open(file.string());
  if (!opened) return named(opened.error().message);
  if (const Status is = CheckIsBuffer(*opened, file.filename().string()); !is)
    return named(is.error().message);
  buffer.size = opened->size();
  buffer.file = std::move(*opened);
  return buffer;
}

bool GltfDocument::HasBytes(uint64_t index) const {
  const auto json = Find("buffers", index);
  return json && ((*json)->contains("uri") || (index == 0 && glb_size_ != 0));
}

std::string GltfDocument::FileNameOf(const std::string& uri) const {
  std::string decoded = PercentDecoded(uri);
  if (decoded == uri) return decoded;
  // Some exporters write names without encoding them: "50%20.bin".
  std::error_code none;
  const bool as_it_is =
      !std::filesystem::exists(PathOf(decoded), none) && std::filesystem::exists(PathOf(uri), none);
  return as_it_is ? uri : decoded;
}

std::filesystem::path GltfDocument::PathOf(const std::string& name) const {
  const std::vector<std::filesystem::path> folders = FoldersOf(path_);
  std::error_code none;
  for (const std::filesystem::path& folder : folders)
    if (std::filesystem::exists(folder / name, none)) return folder / name;
  return folders.front() / name;
}

Result<Bytes> GltfDocument::ReadDataUri(const std::string& uri, const std::string& where) {
  const auto named = [&](const char* what) { return FailAt(fmt::format("{}: {}", where, what)); };
  const size_t comma = uri.find(',');
  if (comma == std::string::npos) return named("its data: URI has no data");
  const bool base64 = uri.find(";base64") < comma;
  // A data: URI may be percent-encoded like any URI.
  const std::string_view data = std::string_view(uri).substr(comma + 1);
  const bool escaped = data.find('%') != data.npos;
  const std::string plain = escaped ? PercentDecoded(data) : "";
  const std::string_view text = escaped ? plain : data;
  const auto raw = AsBytes(text);
  auto decoded = base64 ? DecodeBase64(text) : std::optional(Bytes(raw.begin(), raw.end()));
  if (!decoded) return named("its data: URI is not base64");
  inline_bytes_ += decoded->size();
  if (inline_bytes_ > kMostJsonBytes) return named("too many bytes in data: URIs");
  return std::move(*decoded);
}

Result<const GltfDocument::Buffer*> GltfDocument::Reach(uint64_t index, uint64_t offset, uint64_t size) {
  QUARRY_TRY(Find("buffers", index));
  if (buffers_.size() <= index) buffers_.resize(index + 1);
  if (!buffers_[index]) {
    QUARRY_ASSIGN(buffers_[index], OpenBuffer(index));
  }
  const Buffer& buffer = *buffers_[index];
  if (offset > buffer.size || size > buffer.size - offset)
    return FailAt(fmt::format("buffers[{}] ends at byte {}, but bytes up to {} are needed", index,
                              buffer.size, offset + size));
  return &buffer;
}

Status GltfDocument::ReadBuffer(uint64_t index, uint64_t offset, std::span<std::byte> out) {
  if (index == kDecoded) return decoded_.Read(offset, out);
  QUARRY_ASSIGN(const Buffer* buffer, Reach(index, offset, out.size()));
  if (buffer->file) return buffer->file->ReadAt(buffer->begin + offset, out);
  std::memcpy(out.data(), buffer->bytes.data() + offset, out.size());
  return {};
}

Result<GltfDocument::Range> GltfDocument::RangeOf(uint64_t index, uint64_t offset, uint64_t size) {
  QUARRY_ASSIGN(const Buffer* buffer, Reach(index, offset, size));
  if (buffer->file) return Range{buffer->file->path(), buffer->begin + offset, {}};
  return Range{{}, 0, std::span(buffer->bytes).subspan(offset, size)};
}

Result<uint64_t> GltfDocument::Unsigned(const Json& object, const std::string& where, const char* key,
                                        std::optional<uint64_t> fallback) const {
  const auto it = object.find(key);
  if (it == object.end() && fallback) return *fallback;
  if (it == object.end()) return FailAt(fmt::format("{}.{} is missing", where, key));
  // Some programs write all numbers with a decimal point.
  if (it->is_number_float())
    if (const auto real = it->get<double>(); real >= 0 && real < 0x1p53 && real == std::floor(real))
      return static_cast<uint64_t>(real);
  if (!it->is_number_unsigned())
    return FailAt(fmt::format("{}.{} is not a whole number of at least 0", where, key));
  return it->get<uint64_t>();
}

}  // namespace quarry
