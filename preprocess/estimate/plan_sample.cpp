#include "preprocess/estimate/plan_sample.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <glm/common.hpp>
#include <limits>

#include "common/base/bytes.h"
#include "common/base/resource.h"
#include "common/kdtree/trace/triangle_test.h"
#include "preprocess/partition/partition.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/partition/voxel_pipeline.h"
#include "preprocess/smooth/smooth_region.h"
#include "preprocess/spill/spill_file.h"

namespace quarry {
namespace {

constexpr size_t kWindows = 4;
constexpr uint64_t kWindowTriangles = 64 << 10;
constexpr size_t kMostTriangles = 8 * kWindows * kWindowTriangles;

double Distance(const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec3 d = glm::abs(a - b);
  return std::max({d.x, d.y, d.z});
}

bool IsFinite(const glm::dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

/// Places the model as a run would: its middle at the origin, scaled.
class Placing {
 public:
  Placing(const VertexSample& vertices, double scale) : scale_(scale) {
    glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper = -lower;
    for (const glm::dvec3& p : vertices.points()) {
      lower = glm::min(lower, p);
      upper = glm::max(upper, p);
    }
    middle_ = (lower + upper) * 0.5;
    largest_ = static_cast<float>(Distance(upper, middle_) * scale);
  }
  glm::vec3 operator()(const glm::dvec3& p) const { return glm::vec3((p - middle_) * scale_); }
  float largest() const { return largest_; }

 private:
  double scale_;
  glm::dvec3 middle_;
  float largest_;
};

}  // namespace

void VertexSample::Add(const glm::dvec3& position) {
  if (next_++ % step_ != 0 || !IsFinite(position)) return;
  points_.push_back(position);
  if (points_.size() < kMost) return;
  for (size_t i = 0; i < kMost / 2; ++i) points_[i] = points_[2 * i];
  points_.resize(kMost / 2);
  step_ *= 2;
}

bool SampleWindow::Holds(const glm::dvec3& p) const { return Distance(p, centre) <= half_side; }

std::vector<SampleWindow> ChooseWindows(const VertexSample& vertices, uint64_t triangles) {
  const std::vector<glm::dvec3>& points = vertices.points();
  if (points.empty()) return {};
  if (triangles <= kWindows * kWindowTriangles) return {{points[0], std::numeric_limits<double>::infinity()}};
  const size_t share = points.size() * kWindowTriangles / triangles;
  std::vector<SampleWindow> windows;
  std::vector<double> distances(points.size());
  for (size_t w = 0; w < kWindows; ++w) {
    const glm::dvec3 centre = points[(2 * w + 1) * points.size() / (2 * kWindows)];
    for (size_t i = 0; i < points.size(); ++i) distances[i] = Distance(points[i], centre);
    const auto last = distances.begin() + static_cast<std::ptrdiff_t>(share);
    std::nth_element(distances.begin(), last, distances.end());
    windows.push_back({centre, *last});
  }
  return windows;
}

WindowSink::WindowSink(size_t file, std::span<const SampleWindow> windows, uint64_t vertices)
    : file_(file), windows_(windows), inside_(vertices) {}

Status WindowSink::BeginFile(std::string_view) {
  ++begun_;
  smoothing_ = kSmoothByAngle;
  return {};
}

Status WindowSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  if (!here()) return {};
  Vertex vertex{position, color};
  for (size_t w = 0; w < windows_.size(); ++w)
    vertex.windows |= static_cast<uint32_t>(windows_[w].Holds(position)) << w;
  if (vertex.windows != 0 && next_ < inside_.size()) {
    inside_[next_] = true;
    vertices_.push_back({next_, vertex});
  }
  ++next_;
  return {};
}

Status WindowSink::AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) {
  if (corners.size() < 3) return {};
  const uint32_t first_id = next_id_;
  next_id_ += static_cast<uint32_t>(corners.size()) - 2;
  if (!here() || triangles_.size() >= kMostTriangles) return {};
  const auto windows_of = [&](size_t corner) {
    const uint32_t index = corners[corner].position;
    return index < inside_.size() && inside_[index] ? Find(index)->windows : 0;
  };
  const uint32_t owners = windows_of(0);
  uint32_t before = windows_of(1);
  for (size_t i = 2; i < corners.size(); ++i) {
    const uint32_t now = windows_of(i), windows = owners | before | now;
    before = now;
    if (windows == 0) continue;
    triangles_.push_back({{corners[0], corners[i - 1], corners[i]},
                          first_id + static_cast<uint32_t>(i) - 2,
                          material == kNoIndex ? 0 : material,
                          part == kNoIndex ? 0 : part,
                          smoothing_,
                          windows,
                          owners});
  }
  return {};
}

const WindowSink::Vertex* WindowSink::Find(uint32_t index) const {
  const auto it = std::ranges::lower_bound(vertices_, index, {}, &Numbered::index);
  return it != vertices_.end() && it->index == index ? &it->vertex : nullptr;
}

namespace {

/// The indices that `of` gives for the corners of all triangles in the cubes, without kNoIndex.
template <class Of>
std::vector<uint32_t> IndicesOf(const WindowSink& windows, Of&& of) {
  std::vector<uint32_t> indices;
  for (const WindowSink::Triangle& t : windows.triangles())
    for (const Corner& corner : t.corners)
      if (const uint32_t index = of(corner); index != kNoIndex) indices.push_back(index);
  return indices;
}

}  // namespace

CornerSink::CornerSink(size_t file, const WindowSink& windows)
    : file_(file),
      windows_(windows),
      beyond_(IndicesOf(windows,
                        [&](const Corner& c) { return windows.Find(c.position) ? kNoIndex : c.position; })),
      normals_(IndicesOf(windows, [](const Corner& c) { return c.normal; })),
      uvs_(IndicesOf(windows, [](const Corner& c) { return c.uv; })) {}

Status CornerSink::BeginFile(std::string_view) {
  ++begun_;
  return {};
}

Status CornerSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  if (here()) beyond_.Offer({position, color});
  return {};
}

Status CornerSink::AddNormal(const glm::vec3& normal) {
  if (here()) normals_.Offer(normal);
  return {};
}

Status CornerSink::AddUv(const glm::vec2& uv) {
  if (here()) uvs_.Offer(uv);
  return {};
}

bool CornerSink::Resolve(const WindowSink::Triangle& triangle, glm::dvec3 (&positions)[3],
                         TriangleRecord& record) const {
  record.id = triangle.id;
  record.material = static_cast<uint16_t>(triangle.material);
  record.smoothing = triangle.smoothing;
  record.part = triangle.part;
  for (size_t k = 0; k < 3; ++k) {
    const Corner& corner = triangle.corners[k];
    const WindowSink::Vertex* const inside = windows_.Find(corner.position);
    const WindowSink::Vertex* const vertex = inside ? inside : beyond_.Find(corner.position);
    if (!vertex || !IsFinite(vertex->position)) return false;
    positions[k] = vertex->position;
    record.colors[k] = Packed(vertex->color);
    if (const glm::vec3* const normal = normals_.Find(corner.normal)) record.normals[k] = *normal;
    if (const glm::vec2* const uv = uvs_.Find(corner.uv)) record.uvs[k] = *uv;
  }
  MarkOwnNormals(record);
  return true;
}

namespace {

/// Packed bytes over bytes, of these records in spill files.
double SpilledShare(const std::vector<std::vector<TriangleRecord>>& records, Attributes attributes) {
  const size_t size = RecordBytes(attributes);
  uint64_t all = 0, packed = 0;
  for (const std::vector<TriangleRecord>& some : records) {
    Bytes bytes(some.size() * size);
    for (size_t i = 0; i < some.size(); ++i) std::memcpy(&bytes[i * size], &some[i], size);
    all += bytes.size();
    packed += SpillFile::PackedBytes(bytes);
  }
  return static_cast<double>(packed) / static_cast<double>(all);
}

}  // namespace

Result<SampleCost> MeasureWindows(const PreprocessOptions& options, std::span<const SampleWindow> windows,
                                  const VertexSample& vertices, const WindowSink& content,
                                  const CornerSink& corners, Attributes attributes) {
  const Placing place(vertices, options.scale);
  const float padding = ReferencePadding(place.largest());
  std::vector<std::vector<TriangleRecord>> records(windows.size());
  std::vector<Box> bounds(windows.size(), EmptyBox());
  uint64_t owned = 0;
  for (const WindowSink::Triangle& t : content.triangles()) {
    TriangleRecord record;
    glm::dvec3 positions[3];
    if (!corners.Resolve(t, positions, record)) continue;
    for (size_t k = 0; k < 3; ++k) record.vertices[k] = place(positions[k]);
    if (FaultOf(record) != TriangleFault::kNone) continue;
    const Box box = record.PaddedBox(0);
    if (Distance(box.lower, box.upper) > 1e30) continue;
    owned += static_cast<uint64_t>(std::popcount(t.owners));
    for (size_t w = 0; w < windows.size(); ++w) {
      if ((t.windows >> w & 1) == 0) continue;
      records[w].push_back(record);
      bounds[w].Include(box.lower);
      bounds[w].Include(box.upper);
    }
  }
  // No result: corners do not exist, or come after their triangles.
  if (owned < kFewestTriangles) return kUsualCost;
  const double spilled = SpilledShare(records, attributes);
  double bytes = 0;
  const auto start = std::chrono::steady_clock::now();
  VoxelPipeline pipeline(
      options.threads,
      [&](const VoxelTask& task) {
        return BuildVoxel(task.triangles, task.cell, padding,
                          {attributes != Attributes::kNone, options.crease > 0}, options.voxel_size);
      },
      [&](const EncodedVoxel& voxel) {
        bytes += static_cast<double>(voxel.hot.size() + voxel.shading.size());
        return Status{};
      });
  for (size_t w = 0; w < windows.size(); ++w) {
    if (records[w].empty()) continue;
    Box cell{bounds[w].lower - glm::vec3(2 * padding), bounds[w].upper + glm::vec3(2 * padding)};
    if (std::isfinite(windows[w].half_side)) {
      const glm::dvec3 half(windows[w].half_side);
      cell.lower = glm::max(cell.lower, place(windows[w].centre - half));
      cell.upper = glm::min(cell.upper, place(windows[w].centre + half));
    }
    if (options.crease > 0) QUARRY_TRY(SmoothRecords(records[w], cell, nullptr, options.crease));
    const PartitionOptions partition{padding, options.voxel_size, options.memory, ""};
    QUARRY_TRY(PartitionInMemory(records[w], {cell}, partition,
                                 [&](VoxelTask task) { return pipeline.Add(std::move(task)); }));
  }
  QUARRY_TRY(pipeline.Finish());
  return SampleCost{SecondsSince(start) / static_cast<double>(owned), bytes / static_cast<double>(owned),
                    spilled};
}

}  // namespace quarry
