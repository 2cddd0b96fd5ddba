#include "preprocess/spill_sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace quarry {

/// One triangle with its indices not yet resolved.
struct SpillSink::Face {
  Corner corners[3];
  uint32_t id = 0;
  uint32_t material = 0;
  uint32_t part = 0;
};

namespace {

struct StoredPosition {
  glm::vec3 position;
  uint32_t color;
};

constexpr float kLargestCoordinate = 0x1p60f;
constexpr uint64_t kMaxTriangles = 0xFFFFFFFFull;  // ids are 32 bits; the last is "none"

bool IsUsable(const glm::vec3& p) {
  return std::fabs(p.x) <= kLargestCoordinate && std::fabs(p.y) <= kLargestCoordinate &&
         std::fabs(p.z) <= kLargestCoordinate;
}

bool HasArea(const TriangleRecord& r) {
  const glm::dvec3 a = glm::dvec3(r.vertices[1]) - glm::dvec3(r.vertices[0]);
  const glm::dvec3 b = glm::dvec3(r.vertices[2]) - glm::dvec3(r.vertices[0]);
  return a.y * b.z != a.z * b.y || a.z * b.x != a.x * b.z || a.x * b.y != a.y * b.x;
}

/// The part [first, first + count) of one attribute stream, held in memory.
struct Window {
  uint64_t first = 0, count = 0;
  std::vector<std::byte> bytes;

  Status Load(const SpillFile& file, uint64_t from, uint64_t window) {
    first = from;
    count = from < file.count() ? std::min(window, file.count() - from) : 0;
    bytes.resize(count * file.element_bytes());
    return file.Read(first, bytes);
  }
  template <class T>
  bool Find(uint32_t index, T& value) const {
    if (index < first || index - first >= count) return false;
    std::memcpy(&value, bytes.data() + (index - first) * sizeof(T), sizeof(T));
    return true;
  }
};

}  // namespace

SpillSink::SpillSink(std::string folder, uint64_t memory, double scale,
                     std::function<void(const std::string&)> warn)
    : folder_(std::move(folder)), memory_(memory), scale_(scale), warn_(std::move(warn)) {}

Status SpillSink::BeginFile(std::string_view name) {
  file_name_ = name;
  file_part_ = kNoIndex;
  file_parts_.clear();
  QUARRY_ASSIGN(positions_, SpillFile::Create(folder_, sizeof(StoredPosition)));
  QUARRY_ASSIGN(normals_, SpillFile::Create(folder_, sizeof(glm::vec3)));
  QUARRY_ASSIGN(uvs_, SpillFile::Create(folder_, sizeof(glm::vec2)));
  QUARRY_ASSIGN(faces_, SpillFile::Create(folder_, sizeof(Face)));
  return {};
}

uint32_t SpillSink::AddMaterial(const Material& material) {
  scene_.materials.push_back(material);
  return static_cast<uint32_t>(scene_.materials.size() - 1);
}

uint32_t SpillSink::AddPart(std::string_view name) {
  const auto next = static_cast<uint32_t>(scene_.parts.size());
  const auto [it, added] = file_parts_.emplace(name, next);
  if (added) scene_.parts.emplace_back(name);
  return it->second;
}

uint32_t SpillSink::DefaultMaterial() {
  if (default_material_ == kNoIndex) default_material_ = AddMaterial(Material{"default"});
  return default_material_;
}

Status SpillSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  const uint32_t packed = Packed(color);
  if (packed != 0xFFFFFFFFu) scene_.has_shading = true;
  const glm::dvec3 scaled = position * scale_;
  if (!has_offset_) ChooseOffset(scaled);
  const StoredPosition stored{glm::vec3(scaled - scene_.offset), packed};
  return positions_->Append(&stored);
}

/// By the first position, so that the rest can stream: axes on which it lies beyond kFar are moved by whole
/// steps.
void SpillSink::ChooseOffset(const glm::dvec3& first) {
  constexpr double kFar = 16384, kStep = 1024, kMost = 0x1p60;
  for (int a = 0; a < 3; ++a)
    if (!(std::fabs(first[a]) <= kMost)) return;  // wait for one that is a place
  has_offset_ = true;
  for (int a = 0; a < 3; ++a)
    if (std::fabs(first[a]) >= kFar) scene_.offset[a] = std::round(first[a] / kStep) * kStep;
}

Status SpillSink::AddNormal(const glm::vec3& normal) {
  scene_.has_shading = true;
  return normals_->Append(&normal);
}

Status SpillSink::AddUv(const glm::vec2& uv) {
  scene_.has_shading = true;
  return uvs_->Append(&uv);
}

Status SpillSink::AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) {
  if (corners.size() < 3) return {};
  if (part == kNoIndex && file_part_ == kNoIndex) file_part_ = AddPart(file_name_);
  Face face;
  face.material = material == kNoIndex ? DefaultMaterial() : material;
  face.part = part == kNoIndex ? file_part_ : part;
  for (size_t i = 2; i < corners.size(); ++i) {
    if (scene_.input_triangles + 1 >= kMaxTriangles)
      return Fail(fmt::format("{}: more than {} triangles in all: ids are 32 bits; split the model",
                              file_name_, kMaxTriangles - 1));
    face.corners[0] = corners[0];
    face.corners[1] = corners[i - 1];
    face.corners[2] = corners[i];
    face.id = static_cast<uint32_t>(scene_.input_triangles++);
    QUARRY_TRY(faces_->Append(&face));
  }
  return {};
}

void SpillSink::Warn(std::string message) {
  warn_(message);
  scene_.warnings.push_back(std::move(message));
}

Status SpillSink::KeepTriangle(const TriangleRecord& record) {
  if (!IsUsable(record.vertices[0]) || !IsUsable(record.vertices[1]) || !IsUsable(record.vertices[2])) {
    ++scene_.dropped_not_finite;
    return {};
  }
  if (!HasArea(record)) {
    ++scene_.dropped_degenerate;
    return {};
  }
  for (const glm::vec3& v : record.vertices) scene_.bounds.Include(v);
  return scene_.triangles->Append(&record);
}

Status SpillSink::EndFile() {
  for (auto* file : {&positions_, &normals_, &uvs_, &faces_}) QUARRY_TRY((*file)->FinishWriting());
  QUARRY_TRY(PrepareTriangles());
  QUARRY_TRY(Resolve());
  positions_.reset();
  normals_.reset();
  uvs_.reset();
  faces_.reset();
  return {};
}

/// A place for records, with shading if any file has had some so far; those kept before are copied.
Status SpillSink::PrepareTriangles() {
  const size_t bytes = RecordBytes(scene_.has_shading);
  if (scene_.triangles && scene_.triangles->element_bytes() == bytes) return {};
  std::optional<SpillFile> before = std::move(scene_.triangles);
  QUARRY_ASSIGN(scene_.triangles, SpillFile::Create(folder_, bytes));
  if (!before) return {};
  QUARRY_TRY(before->FinishWriting());
  SpillReader records(*before);
  while (const std::byte* kept = records.Next()) {
    TriangleRecord record;
    std::memcpy(&record, kept, before->element_bytes());
    QUARRY_TRY(scene_.triangles->Append(&record));
  }
  return records.status();
}

/// Pass k fills in the corners whose position, normal or uv lies in window k of its stream; records that wait
/// for a later window travel through a spill file of their own.
Status SpillSink::Resolve() {
  const uint64_t window_bytes = std::max<uint64_t>(memory_ / 4, 1 << 20);
  const uint64_t window = std::max<uint64_t>(window_bytes / (sizeof(StoredPosition) + 12 + 8), 1024);
  const uint64_t longest = std::max({positions_->count(), normals_->count(), uvs_->count()});
  std::optional<SpillFile> partial;
  for (uint64_t first = 0; first == 0 || first < longest; first += window) {
    const bool last = first + window >= longest;
    Window positions, normals, uvs;
    QUARRY_TRY(positions.Load(*positions_, first, window));
    QUARRY_TRY(normals.Load(*normals_, first, window));
    QUARRY_TRY(uvs.Load(*uvs_, first, window));
    std::optional<SpillFile> next;
    if (!last) {
      QUARRY_ASSIGN(next, SpillFile::Create(folder_, RecordBytes(scene_.has_shading)));
    }
    SpillReader faces(*faces_);
    std::optional<SpillReader> records;
    if (partial) records.emplace(*partial);
    while (const std::byte* bytes = faces.Next()) {
      Face face;
      std::memcpy(&face, bytes, sizeof face);
      TriangleRecord record;
      if (records) {
        const std::byte* kept = records->Next();
        if (!kept) return records->status();
        std::memcpy(&record, kept, partial->element_bytes());
      }
      record.id = face.id;
      record.material = face.material;
      record.part = face.part;
      for (int c = 0; c < 3; ++c) {
        const Corner& corner = face.corners[c];
        if (corner.position >= positions_->count() ||
            (corner.normal != kNoIndex && corner.normal >= normals_->count()) ||
            (corner.uv != kNoIndex && corner.uv >= uvs_->count()))
          return Fail(
              fmt::format("{}: triangle {} refers to a vertex that the file does not have ({} vertices, {} "
                          "normals, {} texture coordinates)",
                          file_name_, face.id, positions_->count(), normals_->count(), uvs_->count()));
        StoredPosition position;
        if (positions.Find(corner.position, position)) {
          record.vertices[c] = position.position;
          record.shading[c].color = position.color;
        }
        normals.Find(corner.normal, record.shading[c].normal);
        uvs.Find(corner.uv, record.shading[c].uv);
      }
      QUARRY_TRY(last ? KeepTriangle(record) : next->Append(&record));
    }
    QUARRY_TRY(faces.status());
    if (next) QUARRY_TRY(next->FinishWriting());
    partial = std::move(next);
  }
  return {};
}

Result<ImportedScene> SpillSink::Finish() {
  QUARRY_TRY(scene_.triangles->FinishWriting());
  if (scene_.materials.empty()) DefaultMaterial();
  if (scene_.materials.size() > 65536) return Fail(fmt::format("{}: more than 65536 materials", file_name_));
  if (scene_.triangles->count() == 0)
    return Fail(fmt::format("{}: no triangle is left: {} degenerate, {} with coordinates that are not finite",
                            file_name_, scene_.dropped_degenerate, scene_.dropped_not_finite));
  return std::move(scene_);
}

}  // namespace quarry
