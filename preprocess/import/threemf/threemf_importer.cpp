// 3MF: the triangles of the objects that the build shows, transformed to the build's coordinates. The archive
// is read twice: first for its objects and the number of times that each is shown, then for their triangles.

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "preprocess/import/formats.h"
#include "preprocess/import/origin_survey.h"
#include "preprocess/import/threemf/package.h"
#include "preprocess/import/threemf/shape_reader.h"
#include "preprocess/import/threemf/structure.h"
#include "preprocess/import/threemf/zip_archive.h"

namespace quarry {
namespace {

class ThreeMfImport {
 public:
  ThreeMfImport(ZipArchive archive, ModelSink& sink) : archive_(std::move(archive)), sink_(sink) {}

  Result<uint64_t> Run() {
    QUARRY_ASSIGN(const uint64_t model, FindModelPart(archive_));
    QUARRY_TRY(ReadStructure(model));
    if (sink_.WantsOrigin()) FindOrigin();
    ShapeReader shapes(archive_.path(), structure_, sink_);
    structure_.properties.GiveTo(sink_);
    QUARRY_TRY(ReadShapes(shapes, [this](uint64_t done, uint64_t all) {
      sink_.HasRead(archive_.size() * done / std::max<uint64_t>(all, 1), archive_.size());
    }));
    shapes.Finish();
    return shapes.triangles();
  }

 private:
  Status ReadStructure(uint64_t model) {
    WarnOnce warn(sink_);
    QUARRY_ASSIGN(structure_, ReadThreeMfStructure(archive_, model, warn));
    return {};
  }

  /// Reads the first triangles to find a point for the scene's offset.
  void FindOrigin() {
    OriginSurvey survey;
    ShapeReader shapes(archive_.path(), structure_, survey);
    structure_.properties.GiveTo(survey);
    (void)ReadShapes(shapes, {});  // errors are reported when the model is read
    if (const auto place = survey.Place()) sink_.SetOrigin(*place);
  }

  /// on_read(done, all): bytes once unpacked.
  Status ReadShapes(ShapeReader& shapes, const std::function<void(uint64_t, uint64_t)>& on_read) {
    archive_.RestartLimit();
    uint64_t all = 0, done = 0, reported_at = 0;
    for (const ThreeMfStructure::Part& part : structure_.parts) all += archive_.StatedSize(part.entry);
    for (uint32_t part = 0; part < structure_.parts.size(); ++part) {
      shapes.BeginPart(part);
      QUARRY_TRY(ReadXml(archive_, structure_.parts[part].entry, shapes, [&](uint64_t bytes) {
        constexpr uint64_t kStep = 1 << 20;
        done += bytes;
        if (!on_read || done - reported_at < kStep) return;
        reported_at = done;
        on_read(std::min(done, all), all);
      }));
    }
    return {};
  }

  ZipArchive archive_;
  ModelSink& sink_;
  ThreeMfStructure structure_;
};

}  // namespace

bool LooksLikeThreeMf(ModelReader& bytes) {
  if (!bytes.Ensure(4) || !bytes.view().starts_with("PK\3\4") || !bytes.can_reopen() || bytes.is_packed())
    return false;
  Result<ZipArchive> archive = ZipArchive::Open(bytes.path(), bytes.unpack_limit());
  return archive && FindModelPart(*archive);
}

Result<uint64_t> ImportThreeMf(ModelReader& bytes, ModelSink& sink) {
  if (bytes.is_packed())
    return Fail(fmt::format("{}: is a 3MF that is packed once more; unpack it first", bytes.path()));
  QUARRY_ASSIGN(ZipArchive archive, ZipArchive::Open(bytes.path(), bytes.unpack_limit()));
  return ThreeMfImport(std::move(archive), sink).Run();
}

}  // namespace quarry
