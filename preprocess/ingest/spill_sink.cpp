#include "preprocess/ingest/spill_sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <span>
#include <system_error>
#include <utility>

namespace quarry {

namespace {

// A page may be read for so many faces that came; what is saved up has a bound.
constexpr uint32_t kFacesPerLoad = 64, kMostLoads = 4096;
constexpr size_t kBatchFaces = 8192;
constexpr uint64_t kMaxTriangles = 0xFFFFFFFFull;  // ids are 32 bits; the last is "none"

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

/// By how much a placement makes lengths larger: the cube root of what it does to volumes.
double Cubic(const glm::dmat3& turn) { return std::cbrt(glm::determinant(turn)); }

}  // namespace

SpillSink::SpillSink(std::string folder, uint64_t memory, double scale,
                     std::function<void(const std::string&)> warn, bool textures)
    : folder_(std::move(folder)),
      memory_(memory),
      scale_(scale),
      warn_(std::move(warn)),
      textures_(textures),
      images_(folder_ + "/images") {}

glm::dmat3 TurnOf(const Placement& placement, int up_axis) {
  const double angle = placement.turn_degrees * 3.14159265358979323846 / 180;
  const double c = std::cos(angle) * placement.scale, s = std::sin(angle) * placement.scale;
  const int a = (up_axis + 1) % 3, b = (up_axis + 2) % 3;
  glm::dmat3 turn(placement.scale);
  turn[a][a] = turn[b][b] = c;
  turn[a][b] = s;
  turn[b][a] = -s;
  return turn;
}

std::optional<glm::dvec3> OffsetFor(const glm::dvec3& place) {
  constexpr double kFar = 16384, kStep = 1024, kMost = 0x1p60;
  glm::dvec3 offset(0);
  for (int a = 0; a < 3; ++a) {
    if (!(std::fabs(place[a]) <= kMost)) return std::nullopt;
    if (std::fabs(place[a]) >= kFar) offset[a] = std::round(place[a] / kStep) * kStep;
  }
  return offset;
}

void SpillSink::Place(const Placement& placement, int up_axis) {
  placed_ = true;
  turn_ = TurnOf(placement, up_axis);
  translation_ = placement.translation;
}

SpillSink::~SpillSink() {
  if (under_way_.valid()) under_way_.wait();
}

std::string SpillSink::FilePath(const char* stream) const {
  return fmt::format("{}/import-{}", folder_, stream);
}

Status SpillSink::BeginFile(std::string_view name) {
  file_name_ = name;
  if (in_file()) return {};  // restored
  reads_once_ = false;
  face_color_ = 0xFFFFFFFFu;
  file_part_ = kNoIndex;
  first_part_ = static_cast<uint32_t>(scene_.parts.size());
  first_warning_ = static_cast<uint32_t>(scene_.warnings.size());
  file_parts_.clear();
  loads_left_ = kMostLoads;
  faces_to_next_load_ = kFacesPerLoad;
  resolved_ = 0;
  asked_at_ = scene_.input_triangles;
  QUARRY_ASSIGN(positions_, PagedFile::Create(FilePath("positions"), sizeof(StoredPosition)));
  QUARRY_ASSIGN(normals_, PagedFile::Create(FilePath("normals"), sizeof(glm::vec3)));
  QUARRY_ASSIGN(uvs_, PagedFile::Create(FilePath("uvs"), sizeof(glm::vec2)));
  QUARRY_ASSIGN(waiting_, SpillFile::Open(FilePath("waiting"), sizeof(Face), 0));
  return scene_.triangles ? Status{} : OpenTriangles();
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

glm::dvec3 SpillSink::InScene(const glm::dvec3& position) const {
  return (placed_ ? turn_ * position + translation_ : position) * scale_;
}

glm::dvec3 SpillSink::Turned(const glm::dvec3& direction) const {
  return placed_ ? turn_ * direction : direction;
}

/// Under a name of its own.
template <class View>
void SpillSink::Keep(View view, bool sane, size_t most, std::vector<View>& views) {
  if (!sane || views.size() >= most) {
    if (!warned_of_views_)
      Warn(fmt::format(
          "{}: {} is left out: {}", file_name_, view.name.empty() ? "a view" : view.name,
          sane ? fmt::format("a store holds {} of its kind", most) : "it holds numbers that cannot be"));
    warned_of_views_ = true;
    return;
  }
  const std::string name = view.name;
  const auto taken = [&] {
    return std::ranges::any_of(views, [&](const View& other) { return other.name == view.name; });
  };
  for (int number = 2; taken(); ++number) view.name = fmt::format("{} {}", name, number);
  views.push_back(std::move(view));
}

void SpillSink::AddCamera(NamedCamera camera) {
  CameraSpec& spec = camera.spec;
  const glm::dvec3 way = Turned(spec.at - spec.eye);
  spec.eye = InScene(spec.eye);
  spec.at = spec.eye + way;
  spec.up = Turned(spec.up);
  spec.ortho_height *= scale_ * Cubic(turn_);
  const bool sane = IsSane(spec);
  Keep(std::move(camera), sane, kMaxSceneCameras, scene_.views.cameras);
}

void SpillSink::AddLight(NamedLight light) {
  const double larger = scale_ * Cubic(turn_);
  if (light.kind == LightKind::kPoint) light.radiance *= static_cast<float>(larger * larger);
  light.position = InScene(light.position);
  light.direction = glm::vec3(glm::normalize(Turned(glm::dvec3(light.direction))));
  const bool sane = IsSane(light);
  Keep(std::move(light), sane, kMaxLights, scene_.views.lights);
}

uint32_t SpillSink::DefaultMaterial() {
  if (default_material_ == kNoIndex) default_material_ = AddMaterial(Material{"default"});
  return default_material_;
}

std::string SpillSink::PartialPath(int number) const { return FilePath(number ? "partial-1" : "partial-0"); }
std::string SpillSink::TrianglesPath() const {
  return fmt::format("{}/triangles-{}", folder_, static_cast<int>(scene_.attributes));
}

Result<SpillFile> SpillSink::OpenTrianglesFile(uint64_t count) {
  SpillFile::Options options;
  options.writer = &writer_;
  return SpillFile::Open(TrianglesPath(), RecordBytes(scene_.attributes), count, options);
}

Status SpillSink::OpenTriangles() {
  QUARRY_ASSIGN(scene_.triangles, OpenTrianglesFile(0));
  return {};
}

/// Records have room for attributes once there are some; those kept before are copied.
Status SpillSink::Found(Attributes attributes) {
  scene_.attributes = attributes;
  SpillFile before = std::move(*scene_.triangles);
  QUARRY_TRY(before.FinishWriting());
  QUARRY_TRY(OpenTriangles());
  SpillReader records(before);
  while (const std::byte* kept = records.Next()) {
    TriangleRecord record;
    std::memcpy(&record, kept, before.element_bytes());
    QUARRY_TRY(scene_.triangles->Append(&record));
  }
  QUARRY_TRY(records.status());
  if (noted_)
    superseded_.push_back(std::move(before));  // what Restore would look for
  else
    before.Remove();
  return {};
}

Status SpillSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  QUARRY_TRY(Settle());
  const uint32_t packed = Packed(color);
  if (packed != 0xFFFFFFFFu && scene_.attributes < Attributes::kColors)
    QUARRY_TRY(Found(Attributes::kColors));
  const glm::dvec3 scaled = InScene(position);
  if (!has_offset_) ChooseOffset(scaled);
  const glm::dvec3 exact = scaled - scene_.offset;
  const StoredPosition stored{glm::vec3(exact), packed};
  for (int a = 0; a < 3; ++a) {
    const double loss = std::fabs(exact[a] - stored.position[a]);
    if (loss > largest_loss_) largest_loss_ = loss;
  }
  return positions_->Append(&stored);
}

void SpillSink::SetOrigin(const glm::dvec3& place) { ChooseOffset(InScene(place)); }

/// Before the first position is stored, so that the rest can stream.
void SpillSink::ChooseOffset(const glm::dvec3& place) {
  const std::optional<glm::dvec3> offset = OffsetFor(place);
  has_offset_ = offset.has_value();
  if (offset) scene_.offset = *offset;
}

Status SpillSink::AddNormal(const glm::vec3& normal) {
  QUARRY_TRY(Settle());
  if (scene_.attributes < Attributes::kNormals) QUARRY_TRY(Found(Attributes::kNormals));
  const glm::vec3 turned = placed_ ? glm::vec3(turn_ * glm::dvec3(normal)) : normal;
  return normals_->Append(&turned);
}

Status SpillSink::AddUv(const glm::vec2& uv) {
  QUARRY_TRY(Settle());
  if (scene_.attributes < Attributes::kUvs) QUARRY_TRY(Found(Attributes::kUvs));
  return uvs_->Append(&uv);
}

Status SpillSink::SetFaceColor(const Rgba8& color) {
  face_color_ = Packed(color);
  if (face_color_ == 0xFFFFFFFFu || scene_.attributes >= Attributes::kColors) [[likely]]
    return {};
  QUARRY_TRY(Settle());
  return Found(Attributes::kColors);
}

Status SpillSink::AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) {
  if (corners.size() < 3) return {};
  if (part == kNoIndex && file_part_ == kNoIndex) file_part_ = AddPart(file_name_);
  Face face;
  face.material = material == kNoIndex ? DefaultMaterial() : material;
  face.part = part == kNoIndex ? file_part_ : part;
  face.color = face_color_;
  face.following = static_cast<uint32_t>(corners.size()) - 2;
  for (size_t i = 2; i < corners.size(); ++i) {
    if (scene_.input_triangles + 1 >= kMaxTriangles)
      return Fail(fmt::format("{}: more than {} triangles in all: ids are 32 bits; split the model",
                              file_name_, kMaxTriangles - 1));
    face.corners[0] = corners[0];
    face.corners[1] = corners[i - 1];
    face.corners[2] = corners[i];
    face.id = static_cast<uint32_t>(scene_.input_triangles++);
    --face.following;
    gathered_.push_back(face);
  }
  return gathered_.size() < kBatchFaces ? Status{} : HandOver();
}

/// Gives the gathered faces to the other thread.
Status SpillSink::HandOver() {
  if (under_way_.valid()) QUARRY_TRY(under_way_.get());
  batch_.clear();
  std::swap(batch_, gathered_);
  under_way_ = std::async(std::launch::async, [this] { return ResolveBatch(); });
  return {};
}

/// Afterwards all faces so far are resolved, or wait. What is left is done here: many files change between
/// vertices and faces every few lines.
Status SpillSink::Settle() {
  if (under_way_.valid()) QUARRY_TRY(under_way_.get());
  if (gathered_.empty()) [[likely]]
    return {};
  batch_.clear();
  std::swap(batch_, gathered_);
  return ResolveBatch();
}

/// A polygon's triangles are resolved all together, or wait all together: their vertices decide how it is
/// split.
Status SpillSink::ResolveBatch() {
  for (size_t i = 0, end; i < batch_.size(); i = end) {
    end = i + batch_[i].following + 1;
    fan_.assign(end - i, TriangleRecord{});
    bool resolved = true;
    for (size_t k = i; k < end; ++k) {
      QUARRY_ASSIGN(const bool found, ResolveFace(batch_[k], fan_[k - i]));
      resolved &= found;
    }
    if (resolved) QUARRY_TRY(KeepPolygon());
    for (size_t k = i; k < end && !resolved; ++k) QUARRY_TRY(waiting_->Append(&batch_[k]));
  }
  return {};
}

/// False: it has to wait.
Result<bool> SpillSink::ResolveFace(const Face& face, TriangleRecord& record) {
  if (--faces_to_next_load_ == 0) {
    faces_to_next_load_ = kFacesPerLoad;
    loads_left_ = std::min(loads_left_ + 1, kMostLoads);
  }
  if (ResolveFromMemory(face, record)) [[likely]]
    return true;
  if (loads_left_ == 0) return false;
  QUARRY_TRY(LoadPages(face));
  return ResolveFromMemory(face, record);
}

Status SpillSink::KeepPolygon() {
  if (fan_.size() > 1) polygon_.Split(fan_);
  for (const TriangleRecord& record : fan_) QUARRY_TRY(KeepTriangle(record));
  return {};
}

void SpillSink::Warn(std::string message) {
  const auto told = std::span(scene_.warnings).subspan(first_warning_);
  if (goes_on_ && std::ranges::find(told, message) != told.end()) return;
  warn_(message);
  scene_.warnings.push_back(std::move(message));
}

Status SpillSink::KeepTriangle(const TriangleRecord& record) {
  const TriangleFault fault = FaultOf(record);
  scene_.dropped_not_finite += fault == TriangleFault::kNotFinite;
  scene_.dropped_degenerate += fault == TriangleFault::kDegenerate;
  if (fault != TriangleFault::kNone) return {};
  const Box box = record.PaddedBox(0);
  scene_.bounds.Include(box.lower);
  scene_.bounds.Include(box.upper);
  scene_.sample.Add(record);
  return scene_.triangles->Append(&record);
}

Status SpillSink::EndFile() {
  QUARRY_TRY(Settle());
  QUARRY_TRY(ResolveWaiting());
  const bool noted = std::exchange(file_noted_, false);
  const auto done_with = [&](SpillFile file) {
    if (noted)
      superseded_.push_back(std::move(file));
    else
      file.Remove();
  };
  for (std::optional<PagedFile>* stream : {&positions_, &normals_, &uvs_}) {
    done_with(std::move(**stream).TakeFile());
    stream->reset();
  }
  for (std::optional<SpillFile>* file : {&waiting_, &partial_}) {
    if (*file) done_with(std::move(**file));
    file->reset();
  }
  has_all_ = goes_on_ = false;
  importer_state_.clear();
  return {};
}

/// False: an element is not in memory, or has not come yet.
bool SpillSink::ResolveFromMemory(const Face& face, TriangleRecord& record) {
  const auto find = [](PagedFile& file, uint32_t index, auto& value) {
    const std::byte* found = index < file.count() ? file.Find(index) : nullptr;
    if (found) std::memcpy(&value, found, sizeof value);
    return found != nullptr;
  };
  for (int c = 0; c < 3; ++c) {
    const Corner& corner = face.corners[c];
    StoredPosition position;
    if (!find(*positions_, corner.position, position)) return false;
    record.vertices[c] = position.position;
    record.colors[c] = face.color == 0xFFFFFFFFu ? position.color : face.color;
    if (corner.normal != kNoIndex && !find(*normals_, corner.normal, record.normals[c])) return false;
    if (corner.uv != kNoIndex && !find(*uvs_, corner.uv, record.uvs[c])) return false;
  }
  record.id = face.id;
  record.material = face.material;
  record.part = face.part;
  return true;
}

/// Brings the pages of a triangle's corners to memory, while loads are left.
Status SpillSink::LoadPages(const Face& face) {
  const auto load = [&](PagedFile& file, uint32_t index) -> Status {
    if (index >= file.count() || file.Find(index) || loads_left_ == 0) return {};
    --loads_left_;
    return file.Load(index);
  };
  for (const Corner& corner : face.corners) {
    QUARRY_TRY(load(*positions_, corner.position));
    QUARRY_TRY(load(*normals_, corner.normal));
    QUARRY_TRY(load(*uvs_, corner.uv));
  }
  return {};
}

/// One pass over those that wait for each window of the streams that fits in memory.
Status SpillSink::ResolveWaiting() {
  constexpr uint64_t kWorthNotes = 1 << 20;
  QUARRY_TRY(waiting_->FinishWriting());
  if (waiting_->count() == 0) return {};
  const bool noted = note_ && !reads_once_ && waiting_->count() >= kWorthNotes;
  if (!std::exchange(has_all_, true)) {
    for (PagedFile* stream : {&*positions_, &*normals_, &*uvs_}) QUARRY_TRY(stream->FinishWriting());
    if (noted) QUARRY_TRY(Note());
  }
  const uint64_t window_bytes = std::max<uint64_t>(memory_ / 4, 1 << 20);
  const uint64_t window = std::max<uint64_t>(window_bytes / (sizeof(StoredPosition) + 12 + 8), 1024);
  const uint64_t longest = std::max({positions_->count(), normals_->count(), uvs_->count()});
  for (;;) {
    QUARRY_TRY(ResolveWindow(window, resolved_ + window >= longest));
    resolved_ += window;
    if (resolved_ >= longest) return {};
    if (noted) QUARRY_TRY(Note());
    std::error_code none;
    std::filesystem::remove(PartialPath(partial_number_ ^ 1), none);  // the pass before it
  }
}

/// Fills in the corners whose position, normal or uv lies in the next window of its stream; records that wait
/// for a later one travel through files of their own, two by turns.
Status SpillSink::ResolveWindow(uint64_t window, bool last) {
  const SpillFile &all_positions = positions_->file(), &all_normals = normals_->file(),
                  &all_uvs = uvs_->file();
  Window positions, normals, uvs;
  QUARRY_TRY(positions.Load(all_positions, resolved_, window));
  QUARRY_TRY(normals.Load(all_normals, resolved_, window));
  QUARRY_TRY(uvs.Load(all_uvs, resolved_, window));
  std::optional<SpillFile> next;
  if (!last) {
    partial_number_ ^= 1;
    QUARRY_ASSIGN(next, SpillFile::Open(PartialPath(partial_number_), RecordBytes(scene_.attributes), 0));
  }
  fan_.clear();
  SpillReader faces(*waiting_);
  std::optional<SpillReader> records;
  if (partial_) records.emplace(*partial_);
  while (const std::byte* bytes = faces.Next()) {
    Face face;
    std::memcpy(&face, bytes, sizeof face);
    TriangleRecord record;
    if (records) {
      const std::byte* kept = records->Next();
      if (!kept) return records->status();
      std::memcpy(&record, kept, partial_->element_bytes());
    }
    record.id = face.id;
    record.material = face.material;
    record.part = face.part;
    for (int c = 0; c < 3; ++c) {
      const Corner& corner = face.corners[c];
      if (corner.position >= all_positions.count() ||
          (corner.normal != kNoIndex && corner.normal >= all_normals.count()) ||
          (corner.uv != kNoIndex && corner.uv >= all_uvs.count()))
        return Fail(
            fmt::format("{}: triangle {} refers to a vertex that the file does not have ({} vertices, {} "
                        "normals, {} texture coordinates)",
                        file_name_, face.id, all_positions.count(), all_normals.count(), all_uvs.count()));
      StoredPosition position;
      if (positions.Find(corner.position, position)) {
        record.vertices[c] = position.position;
        record.colors[c] = face.color == 0xFFFFFFFFu ? position.color : face.color;
      }
      normals.Find(corner.normal, record.normals[c]);
      uvs.Find(corner.uv, record.uvs[c]);
    }
    if (!last) {
      QUARRY_TRY(next->Append(&record));
      continue;
    }
    fan_.push_back(record);
    if (face.following == 0) {
      QUARRY_TRY(KeepPolygon());
      fan_.clear();
    }
  }
  QUARRY_TRY(faces.status());
  if (next) QUARRY_TRY(next->FinishWriting());
  if (next) partial_ = std::move(next);
  return {};
}

}  // namespace quarry
