#include "preprocess/ingest/vertex_streams.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace quarry {

std::vector<std::string> VertexStreams::Paths(const std::string& folder) {
  return {folder + "/import-positions", folder + "/import-normals", folder + "/import-uvs"};
}

Result<VertexStreams> VertexStreams::Create(const std::string& folder) {
  const std::vector<std::string> paths = Paths(folder);
  QUARRY_ASSIGN(PagedFile positions, PagedFile::Create(paths[0], sizeof(StoredPosition)));
  QUARRY_ASSIGN(PagedFile normals, PagedFile::Create(paths[1], sizeof(glm::vec3)));
  QUARRY_ASSIGN(PagedFile uvs, PagedFile::Create(paths[2], sizeof(glm::vec2)));
  return VertexStreams(std::move(positions), std::move(normals), std::move(uvs));
}

Result<VertexStreams> VertexStreams::Restore(const std::string& folder, ByteReader& saved) {
  const std::vector<std::string> paths = Paths(folder);
  QUARRY_ASSIGN(PagedFile positions, PagedFile::Restore(paths[0], sizeof(StoredPosition), saved));
  QUARRY_ASSIGN(PagedFile normals, PagedFile::Restore(paths[1], sizeof(glm::vec3), saved));
  QUARRY_ASSIGN(PagedFile uvs, PagedFile::Restore(paths[2], sizeof(glm::vec2), saved));
  return VertexStreams(std::move(positions), std::move(normals), std::move(uvs));
}

Status VertexStreams::Save(ByteWriter& out) {
  for (PagedFile* stream : {&positions_, &normals_, &uvs_}) QUARRY_TRY(stream->Save(out));
  return {};
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

std::vector<SpillFile> VertexStreams::TakeFiles() && {
  std::vector<SpillFile> files;
  for (PagedFile* stream : {&positions_, &normals_, &uvs_}) files.push_back(std::move(*stream).TakeFile());
  return files;
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
