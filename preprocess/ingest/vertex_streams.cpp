#include "preprocess/ingest/vertex_streams.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace quarry {

Result<VertexStreams> VertexStreams::Open(const std::string& folder) {
  const auto open = [&](const char* stream, size_t element_bytes) {
    return PagedFile::Create(folder + "/import-" + stream, element_bytes);
  };
  QUARRY_ASSIGN(PagedFile positions, open("positions", sizeof(StoredPosition)));
  QUARRY_ASSIGN(PagedFile normals, open("normals", sizeof(glm::vec3)));
  QUARRY_ASSIGN(PagedFile uvs, open("uvs", sizeof(glm::vec2)));
  return VertexStreams(std::move(positions), std::move(normals), std::move(uvs));
}

bool VertexStreams::Has(const Face& face) const {
  return std::ranges::all_of(face.corners, [&](const Corner& c) {
    return c.position < positions() && (c.normal == kNoIndex || c.normal < normals()) &&
           (c.uv == kNoIndex || c.uv < uvs());
  });
}

bool VertexStreams::Find(const Face& face, TriangleRecord& record) {
  const auto find = [](PagedFile& file, uint32_t index, auto& value) {
    const std::byte* found = index < file.count() ? file.Find(index) : nullptr;
    if (found) std::memcpy(&value, found, sizeof value);
    return found != nullptr;
  };
  for (int c = 0; c < 3; ++c) {
    const Corner& corner = face.corners[c];
    StoredPosition position;
    if (!find(positions_, corner.position, position)) return false;
    record.vertices[c] = position.position;
    record.colors[c] = face.color == kWhite ? position.color : face.color;
    if (corner.normal != kNoIndex && !find(normals_, corner.normal, record.normals[c])) return false;
    if (corner.uv != kNoIndex && !find(uvs_, corner.uv, record.uvs[c])) return false;
  }
  record.id = face.id;
  record.material = face.material;
  record.smoothing = face.smoothing;
  record.part = face.part;
  return true;
}

Status VertexStreams::Load(const Face& face, uint32_t& loads) {
  const auto load = [&](PagedFile& file, uint32_t index) -> Status {
    if (index >= file.count() || file.Find(index) || loads == 0) return {};
    --loads;
    return file.Load(index);
  };
  for (const Corner& corner : face.corners) {
    QUARRY_TRY(load(positions_, corner.position));
    QUARRY_TRY(load(normals_, corner.normal));
    QUARRY_TRY(load(uvs_, corner.uv));
  }
  return {};
}

Status VertexStreams::FinishWriting() {
  for (PagedFile* stream : {&positions_, &normals_, &uvs_}) QUARRY_TRY(stream->FinishWriting());
  return {};
}

uint64_t VertexWindow::CountFor(uint64_t bytes) {
  constexpr uint64_t kBytesPerElement =
      sizeof(VertexStreams::StoredPosition) + sizeof(glm::vec3) + sizeof(glm::vec2);
  return std::max<uint64_t>(bytes / kBytesPerElement, 1024);
}

Status VertexWindow::Stretch::Load(const SpillFile& file, uint64_t from, uint64_t window) {
  first = from;
  count = from < file.count() ? std::min(window, file.count() - from) : 0;
  bytes.resize(count * file.element_bytes());
  return file.Read(first, bytes);
}

template <class T>
bool VertexWindow::Stretch::Find(uint32_t index, T& value) const {
  if (index < first || index - first >= count) return false;
  std::memcpy(&value, bytes.data() + (index - first) * sizeof(T), sizeof(T));
  return true;
}

Status VertexWindow::Load(const VertexStreams& streams, uint64_t first, uint64_t count) {
  QUARRY_TRY(positions_.Load(streams.positions_.file(), first, count));
  QUARRY_TRY(normals_.Load(streams.normals_.file(), first, count));
  return uvs_.Load(streams.uvs_.file(), first, count);
}

void VertexWindow::FillIn(const Face& face, TriangleRecord& record) const {
  for (int c = 0; c < 3; ++c) {
    const Corner& corner = face.corners[c];
    VertexStreams::StoredPosition position;
    if (positions_.Find(corner.position, position)) {
      record.vertices[c] = position.position;
      record.colors[c] = face.color == kWhite ? position.color : face.color;
    }
    normals_.Find(corner.normal, record.normals[c]);
    uvs_.Find(corner.uv, record.uvs[c]);
  }
}

}  // namespace quarry
