#include "preprocess/environment/environment_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/resource.h"
#include "common/kdtree/node.h"
#include "common/math/half.h"
#include "common/voxel/store_writer.h"
#include "preprocess/environment/sky_survey.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/texture/image_decoder.h"
#include "preprocess/texture/mip_builder.h"
#include "preprocess/texture/page_pipeline.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

std::string Extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
  return extension;
}

/// Whatever is wrong with the image is wrong with what the user has given.
tl::unexpected<Error> AsUsage(const Error& error) {
  return tl::unexpected<Error>(Error{error.message, ErrorKind::kUsage});
}

Status CheckFacts(const std::string& path, const ImageFacts& facts) {
  if (!facts.real || facts.encoded)
    return BadUsage(
        fmt::format("{}: has whole numbers; an environment is an image of radiance, .hdr or .exr", path));
  if (facts.width != 2 * facts.height)
    return BadUsage(fmt::format(
        "{}: is {} x {} pixels large; an environment shows all directions, and is twice as wide as high",
        path, facts.width, facts.height));
  return {};
}

/// Makes three floats a texel of a row; grey becomes each of them, alpha is left out.
void TakeColors(std::span<const std::byte> row, const ImageFacts& facts, std::vector<float>& colors) {
  const uint32_t channels = facts.channels;
  colors.resize(size_t{3} * facts.width);
  for (uint32_t x = 0; x < facts.width; ++x) {
    float in[4] = {};
    std::memcpy(in, &row[size_t{x} * channels * sizeof(float)], channels * sizeof(float));
    for (int c = 0; c < 3; ++c) colors[size_t{3} * x + static_cast<size_t>(c)] = channels < 3 ? in[0] : in[c];
  }
}

/// An image on its way into a store.
class EnvironmentStage {
 public:
  EnvironmentStage(const PreprocessOptions& options, Progress& progress)
      : options_(options),
        progress_(progress),
        image_{.file = options.models[0],
               .name = std::filesystem::path(options.models[0]).filename().string(),
               .model = options.models[0]},
        decoder_(ImageDecodingOf(options)) {}

  Result<PreprocessStatistics> Run() {
    const auto start = Clock::now();
    NoteModelFile(options_.models[0]);
    QUARRY_TRY(Survey());
    PreprocessStatistics statistics;
    statistics.import_wall_s = SecondsSince(start);
    QUARRY_TRY(Write(statistics));
    statistics.preprocess_wall_s = SecondsSince(start);
    statistics.build_wall_s = statistics.preprocess_wall_s - statistics.import_wall_s;
    statistics.peak_rss_bytes = PeakResidentBytes();
    return statistics;
  }

 private:
  /// Decodes the image; a fault of the image is a fault of usage.
  Status Decode(const ImageDecoder::OnFacts& on_facts, const ImageDecoder::OnRow& on_row) {
    std::optional<Error> own;
    const auto kept = [&](Status status) {
      if (!status) own = status.error();
      return status;
    };
    const Status decoded = decoder_.Decode(
        image_, [&](const ImageFacts& facts) { return kept(on_facts(facts)); },
        [&](std::span<const std::byte> row) { return kept(on_row(row)); });
    if (own) return tl::unexpected<Error>(*own);
    if (!decoded) return decoder_.is_fatal() ? decoded : Status(AsUsage(decoded.error()));
    if (!decoder_.remark().empty()) return BadUsage(decoder_.remark());
    return {};
  }

  Status Survey() {
    progress_.Begin("reading the sky");
    uint32_t y = 0;
    QUARRY_TRY(Decode(
        [&](const ImageFacts& facts) -> Status {
          QUARRY_TRY(CheckFacts(image_.file, facts));
          facts_ = facts;
          survey_.emplace(facts.width);
          return {};
        },
        [&](std::span<const std::byte> row) -> Status {
          TakeColors(row, facts_, colors_);
          uint32_t x = 0;
          if (!survey_->AddRow(colors_, x))
            return BadUsage(fmt::format("{}: its pixel ({}, {}) is no number", image_.file, x, y));
          progress_.Update(++y, uint64_t{2} * facts_.height);
          return {};
        }));
    if (const auto at = survey_->NegativePixel())
      return BadUsage(fmt::format("{}: its pixel ({}, {}) is negative", image_.file, at->x, at->y));
    if (!survey_->Finish()) return BadUsage(fmt::format("{}: is black all over", image_.file));
    return {};
  }

  Status Write(PreprocessStatistics& statistics) {
    QUARRY_ASSIGN(StoreWriter writer, StoreWriter::CreateEnvironment(options_.output));
    const TexelLayout layout{facts_.width, facts_.height, 3, TexelFormat::kHalf};
    writer.BeginTexture(image_.name, layout);
    PagePipeline pages(writer, options_.threads);
    pages.Begin(layout);
    MipBuilder mips(
        layout, [&](uint32_t page, std::span<const std::byte> texels) { return pages.Add(page, texels); });
    Bytes halves(size_t{6} * facts_.width);
    uint32_t y = 0;
    QUARRY_TRY(Decode(
        [&](const ImageFacts& facts) -> Status {
          if (facts.width == facts_.width && facts.height == facts_.height &&
              facts.channels == facts_.channels)
            return {};
          return Fail(fmt::format("{}: has changed meanwhile", image_.file));
        },
        [&](std::span<const std::byte> row) -> Status {
          TakeColors(row, facts_, colors_);
          for (size_t i = 0; i < colors_.size(); ++i) {
            const uint16_t half = FloatToHalf(std::ldexp(std::max(colors_[i], 0.0f), -survey_->exponent()));
            std::memcpy(&halves[2 * i], &half, sizeof half);
            colors_[i] = std::ldexp(HalfToFloat(half), survey_->exponent());
          }
          survey_->AddAgain(colors_);
          progress_.Update(facts_.height + ++y, uint64_t{2} * facts_.height);
          return mips.AddRow(halves);
        }));
    QUARRY_TRY(pages.Finish());
    progress_.End();
    writer.SetSky(std::make_shared<const SkyTable>(survey_->MakeTable()));
    SceneMeta& meta = statistics.meta;
    meta.root_lower = glm::vec3(-1);
    meta.root_upper = glm::vec3(1);
    QUARRY_ASSIGN(statistics.scene_id,
                  writer.Finish(meta, {KdNode::Leaf(0, 0)}, {}, {}, {}, ModelNamesOf(options_)));
    for (const WrittenTexture& texture : writer.textures()) {
      ++statistics.textures.textures;
      statistics.textures.pages += texture.texture.pages.size();
      for (const BlockEntry& page : texture.texture.pages) {
        statistics.textures.stored_bytes += page.stored;
        statistics.textures.decoded_bytes += page.decoded;
      }
    }
    statistics.store_bytes = writer.bytes_written();
    return {};
  }

  const PreprocessOptions& options_;
  Progress& progress_;
  const TextureImage image_;
  ImageDecoder decoder_;
  ImageFacts facts_;
  std::optional<SkySurvey> survey_;
  std::vector<float> colors_;  ///< working memory: a row
};

}  // namespace

bool IsEnvironment(const PreprocessOptions& options) {
  const std::string extension = options.models.size() == 1 ? Extension(options.models[0]) : std::string();
  return extension == ".hdr" || extension == ".exr";
}

Result<PreprocessStatistics> MakeEnvironment(const PreprocessOptions& options, Progress& progress) {
  return EnvironmentStage(options, progress).Run();
}

}  // namespace quarry
