#include "preprocess/import/cad/cad_importer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/descriptor.h"
#include "common/base/log.h"
#include "common/math/elementary.h"
#include "common/scene/open_pbr.h"
#include "common/voxel/parts/part_path.h"
#include "preprocess/import/cad/cad_client.h"
#include "preprocess/import/warn_once.h"

namespace quarry {
namespace {

Status CheckSize(uint64_t bytes, const CadReading& reading) {
  if (bytes <= reading.memory / kCadBytesPerByte) return {};
  return Fail(
      fmt::format("Open CASCADE takes up to {} times its {} MiB of memory: give it --memory {}M, or export "
                  "triangles, as glTF, OBJ or STL, from a CAD program (FreeCAD, say)",
                  kCadBytesPerByte, (bytes >> 20) + 1, (bytes * kCadBytesPerByte >> 20) + 1));
}

/// A file for the helper: the model, or a copy without a name of a model that is packed or comes by a pipe.
class HelperFile {
 public:
  static Result<std::unique_ptr<HelperFile>> Of(ModelReader& bytes, const CadReading& reading) {
    auto file = std::make_unique<HelperFile>();
    if (bytes.can_reopen() && !bytes.is_packed()) {
      QUARRY_TRY(CheckSize(bytes.size(), reading));
      file->path_ = bytes.path();
    } else {
      QUARRY_TRY(file->Copy(bytes, reading));
    }
    return file;
  }
  ~HelperFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  const std::string& path() const { return path_; }

 private:
  Status Copy(ModelReader& bytes, const CadReading& reading) {
    std::error_code none;
    const std::string folder =
        reading.folder.empty() ? std::filesystem::temp_directory_path(none).string() : reading.folder;
    std::string name = folder + "/quarry-cad-XXXXXX";
    fd_ = ::mkostemp(name.data(), O_CLOEXEC);
    if (fd_ < 0) return Fail(fmt::format("{}: a copy of it cannot be made: {}", folder, ErrnoText(errno)));
    ::unlink(name.c_str());
    path_ = fmt::format("/proc/{}/fd/{}", ::getpid(), fd_);
    uint64_t copied = 0;
    while (bytes.Ensure(1)) {
      copied += bytes.available();
      QUARRY_TRY(CheckSize(copied, reading));
      if (!WriteAll(fd_, std::as_bytes(std::span(bytes.data(), bytes.available()))))
        return Fail(fmt::format("{}: a copy of it cannot be written: {}", folder, ErrnoText(errno)));
      bytes.Consume(bytes.available());
    }
    return {};
  }

  std::string path_;
  int fd_ = -1;
};

tl::unexpected<Error> OfFile(const std::string& path, const Error& error) {
  return Fail(fmt::format("{}: {}", path, error.message));
}

Material MaterialOf(const glm::vec3& color, float opacity) {
  Material m;
  int bytes[3];
  for (int a = 0; a < 3; ++a)
    bytes[a] = static_cast<int>(EncodeSrgb(static_cast<double>(color[a])) * 255 + 0.5);
  m.name = fmt::format("#{:02x}{:02x}{:02x}", bytes[0], bytes[1], bytes[2]);
  m.diffuse = color * opacity;
  m.transmittance = glm::vec3(1 - opacity);
  DeriveOpenPbr(m);
  return m;
}

/// Turns the helper's messages into calls of the sink, and believes none of them.
class CadImport {
 public:
  CadImport(const std::string& path, uint64_t size, ModelSink& sink)
      : path_(path), size_(size), sink_(sink), warn_(sink) {
    sink_.SetSmoothing(kFlat);  // of faces without normals: they are planes
  }

  Status Run(CadClient& client) {
    for (;;) {
      const Result<CadClient::Message> message = client.Next(part_name_);
      if (!message) return OfFile(path_, message.error());
      QUARRY_ASSIGN(const bool sound, Take(*message));
      if (!sound) return OfFile(path_, CadClient::Lies().value());
      if (message->kind == CadMessage::kDone) return {};
    }
  }
  uint64_t triangles() const { return triangles_; }

 private:
  /// False: the message cannot be.
  Result<bool> Take(const CadClient::Message& message) {
    ByteReader in(message.content);
    switch (message.kind) {
      case CadMessage::kProgress:
        return TakeProgress(in.Get<double>()) && in.done();
      case CadMessage::kWarning:
        warn_(fmt::format("{}: {}", path_, TextOf(message.content)));
        return true;
      case CadMessage::kFacts:
        return TakeFacts(in);
      case CadMessage::kMaterial:
        return TakeMaterial(in);
      case CadMessage::kPart:
        return EndFace() && TakePart(TextOf(message.content));
      case CadMessage::kFace:
        return EndFace() && TakeFace(in);
      case CadMessage::kPoints:
        return TakePoints(in);
      case CadMessage::kNormals:
        return TakeNormals(in);
      case CadMessage::kTriangles:
        return TakeTriangles(in);
      case CadMessage::kDone:
        return EndFace() && IsAll(in);
      default:
        return false;
    }
  }

  static std::string TextOf(std::span<const std::byte> content) {
    return std::string(AsText(content).substr(0, kMostCadText));
  }

  bool TakeProgress(double share) {
    if (!(share >= 0 && share <= 1)) return false;
    sink_.HasRead(static_cast<uint64_t>(share * static_cast<double>(size_)), size_);
    return true;
  }

  bool TakeFacts(ByteReader& in) {
    const auto origin = in.GetVec3<glm::dvec3>();
    const auto linear = in.Get<double>(), angle = in.Get<double>();
    const std::string unit = TextOf(in.GetSpan(in.remaining()));
    const bool can_be = linear > 0 && angle > 0 && std::isfinite(linear) && std::isfinite(angle);
    if (!in.ok() || has_facts_ || !can_be || Printable(unit) != unit || unit.size() > 16) return false;
    has_facts_ = true;
    for (int a = 0; a < 3; ++a)
      if (!std::isfinite(origin[a])) return false;
    if (sink_.WantsOrigin()) sink_.SetOrigin(origin);
    sink_.Note(fmt::format(
        "{}: coordinates in {}; triangles within {:.3g} {} of the surfaces, and {:.3g} degrees of "
        "each other (--deflection {:.3g},{:.3g})",
        path_, unit, linear, unit, angle, linear, angle));
    return true;
  }

  bool TakeMaterial(ByteReader& in) {
    const auto color = in.GetVec3<glm::vec3>();
    const auto opacity = in.Get<float>();
    for (const float x : {color.r, color.g, color.b, opacity})
      if (!(x >= 0 && x <= 1)) return false;
    if (!in.done()) return false;
    materials_.push_back(sink_.AddMaterial(MaterialOf(color, opacity)));
    return true;
  }

  bool TakePart(std::string_view names) {
    part_ = kNoIndex;
    part_name_.clear();
    for (size_t end; (end = names.find('\0')) != std::string_view::npos; names.remove_prefix(end + 1)) {
      AppendToPath(names.substr(0, end), part_name_, part_ == kNoIndex);
      part_ = sink_.AddPart(names.substr(0, end), part_);
    }
    ++parts_;
    return has_facts_ && names.empty();
  }

  bool TakeFace(ByteReader& in) {
    const auto material = in.Get<uint32_t>();
    if (!in.done() || !has_facts_ || (material != kNoIndex && material >= materials_.size())) return false;
    material_ = material == kNoIndex ? kNoIndex : materials_[material];
    first_point_ += points_;
    first_normal_ += normals_;
    points_ = normals_ = 0;
    in_face_ = true;
    ++faces_;
    return true;
  }

  /// Whether as many parts and faces have come as the helper has sent.
  bool IsAll(ByteReader& in) const {
    const auto parts = in.Get<uint64_t>(), faces = in.Get<uint64_t>();
    return in.done() && parts == parts_ && faces == faces_;
  }

  bool EndFace() const { return normals_ == 0 || normals_ == points_; }

  Result<bool> TakePoints(ByteReader& in) {
    if (!in_face_) return false;
    while (in.remaining() > 0) {
      const auto point = in.GetVec3<glm::dvec3>();
      if (!in.ok() || first_point_ + ++points_ > kMostPoints) return false;
      QUARRY_TRY(sink_.AddPosition(point, {}));
    }
    return true;
  }

  Result<bool> TakeNormals(ByteReader& in) {
    if (!in_face_) return false;
    while (in.remaining() > 0) {
      const auto normal = in.GetVec3<glm::vec3>();
      const float square = normal.x * normal.x + normal.y * normal.y + normal.z * normal.z;
      if (!in.ok() || !(square > 0.9f && square < 1.1f) || ++normals_ > points_) return false;
      QUARRY_TRY(sink_.AddNormal(normal));
    }
    return true;
  }

  Result<bool> TakeTriangles(ByteReader& in) {
    if (!in_face_ || !EndFace()) return false;
    Corner corners[3];
    while (in.remaining() > 0) {
      for (Corner& corner : corners) {
        const auto point = in.Get<uint32_t>();
        if (!in.ok() || point >= points_) return false;
        corner.position = static_cast<uint32_t>(first_point_ + point);
        corner.normal = normals_ > 0 ? static_cast<uint32_t>(first_normal_ + point) : kNoIndex;
      }
      ++triangles_;
      QUARRY_TRY(sink_.AddPolygon(corners, material_, part_));
    }
    return true;
  }

  static constexpr uint64_t kMostPoints = 0xFFFFFFFE;

  const std::string& path_;
  uint64_t size_;
  ModelSink& sink_;
  WarnOnce warn_;
  bool has_facts_ = false, in_face_ = false;
  std::vector<uint32_t> materials_;  ///< numbers of the sink
  uint32_t material_ = kNoIndex, part_ = kNoIndex;
  std::string part_name_;
  uint64_t first_point_ = 0, first_normal_ = 0;  ///< of the current face
  uint64_t points_ = 0, normals_ = 0;            ///< of the current face
  uint64_t parts_ = 0, faces_ = 0, triangles_ = 0;
};

}  // namespace

Result<uint64_t> ImportCad(ModelReader& bytes, CadFormat format, const CadReading& reading, ModelSink& sink) {
  const uint64_t size = bytes.has_size() ? bytes.size() : 1 << 20;
  const auto file = HelperFile::Of(bytes, reading);
  if (bytes.failed()) return bytes.Truncated("");
  if (!file) return OfFile(bytes.path(), file.error());
  CadClient client(reading);
  if (const Status asked = client.Ask(format, (*file)->path()); !asked)
    return OfFile(bytes.path(), asked.error());
  CadImport import(bytes.path(), size, sink);
  QUARRY_TRY(import.Run(client));
  return import.triangles();
}

}  // namespace quarry
