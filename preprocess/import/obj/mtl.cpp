#include "preprocess/import/obj/mtl.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "common/scene/open_pbr.h"
#include "preprocess/import/carried_fields.h"
#include "preprocess/import/foreign/foreign_content.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// A newmtl block as written.
struct MtlBlock {
  std::string name;
  std::optional<glm::dvec3> kd, ks, ke, kr, tf;
  double ns = 0, ni = 1;
  std::optional<double> pm, pr;  ///< metalness and roughness, of the PBR extension
  std::optional<double> d, tr;
  double illum = 2;
  std::map<TextureUse, MtlTexture> textures;
};

/// NaN gives `low`.
float Clamp(double value, double low, double high) {
  return static_cast<float>(value > low ? std::min(value, high) : low);
}

glm::vec3 ClampColor(const glm::dvec3& c, double high = 1.0) {
  return {Clamp(c.x, 0, high), Clamp(c.y, 0, high), Clamp(c.z, 0, high)};
}

/// Programs that make meshes of photographs (openMVS, OpenDroneMap) write "Tr 1" of opaque materials, without
/// "d". Nobody makes a material that is not there at all.
bool MeansOpaque(const MtlBlock& block) { return !block.d && block.tr.value_or(0.0) >= 1; }

double DissolveOf(const MtlBlock& block) {
  if (MeansOpaque(block)) return 1;
  return Clamp(block.d ? *block.d : 1.0 - block.tr.value_or(0.0), 0, 1);
}

/// By the table in mtl.h.
Material ToMaterial(const MtlBlock& block) {
  const int illum = static_cast<int>(Clamp(block.illum, 0, 10));
  const double dissolve = DissolveOf(block);
  const glm::dvec3 kd = block.kd.value_or(glm::dvec3(0.8)), ks = block.ks.value_or(glm::dvec3(0));
  const bool refracts = illum == 4 || illum == 6 || illum == 7 || illum == 9;
  const bool mirrors = illum >= 3 && illum <= 8;
  Material material;
  material.name = block.name;
  material.diffuse = ClampColor(kd * dissolve);
  material.specular = ClampColor(ks);
  material.emission = ClampColor(block.ke.value_or(glm::dvec3(0)), std::numeric_limits<float>::max());
  material.reflectance = ClampColor(block.kr.value_or(mirrors ? ks : glm::dvec3(0)));
  material.transmittance = glm::vec3(static_cast<float>(1.0 - dissolve));
  material.shininess = Clamp(block.ns, 0, 10000);
  material.fresnel = illum == 5 || illum == 7;
  if (refracts) {
    // Tf gives the transmitted light by itself: scaling it by 1 - d, or Kd by d, would count the glass twice.
    if (block.tf) material.diffuse = ClampColor(kd);
    material.transmittance =
        ClampColor(block.tf.value_or(glm::dvec3(dissolve == 1.0 ? 1.0 : 1.0 - dissolve)));
    material.ior = Clamp(block.ni, 1, 10);
  }
  DeriveOpenPbr(material);
  if (!block.pm && !block.pr) return material;
  material.base_color = ClampColor(kd);
  material.base_metalness = Clamp(block.pm.value_or(0), 0, 1);
  if (block.pr) material.specular_roughness = Clamp(*block.pr, 0, 1);
  material.specular_weight = 1;
  if (!refracts) DeriveWhitted(material, false);
  return material;
}

/// The texture with the colour that it multiplies.
MtlTexture Completed(MtlTexture texture, const MtlBlock& block) {
  const auto color = [&](const std::optional<glm::dvec3>& own, double high) {
    texture.binding.factor *= glm::vec4(ClampColor(own.value_or(glm::dvec3(1)), high), 1);
  };
  switch (texture.binding.use) {
    case TextureUse::kDiffuse:
      color(block.kd, 1);
      texture.binding.factor.a = static_cast<float>(DissolveOf(block));
      break;
    case TextureUse::kSpecular:
      color(block.ks, 1);
      break;
    case TextureUse::kEmission:
      color(block.ke, 1e30);
      break;
    case TextureUse::kOpacity:
      texture.binding.factor *= static_cast<float>(DissolveOf(block));
      break;
    default:
      break;
  }
  return texture;
}

/// Without map_d, the alpha of map_Kd is the opacity, if the image has one: exporters of plants and fences
/// write one image for both.
void TakeAlphaOfColor(std::map<TextureUse, MtlTexture>& textures) {
  const auto color = textures.find(TextureUse::kDiffuse);
  if (color == textures.end() || color->second.pick != TexturePick::kColor ||
      textures.contains(TextureUse::kOpacity))
    return;
  color->second.pick = TexturePick::kColorAndAlpha;
  MtlTexture opacity = color->second;
  opacity.binding.use = TextureUse::kOpacity;
  opacity.binding.factor = glm::vec4(1);
  textures.emplace(TextureUse::kOpacity, opacity);
}

class MtlParser {
 public:
  MtlParser(ModelReader& bytes, const std::function<void(std::string)>& warn)
      : path_(bytes.path()), lines_(bytes), warn_(warn) {}

  Result<std::vector<MtlMaterial>> Parse();

 private:
  void Line(std::string_view line);
  void Begin(std::string_view name);
  void End();
  /// Reads three numbers, or one for all three.
  bool Color(TextCursor& rest, std::optional<glm::dvec3>& color);
  bool Texture(TextCursor& rest, MtlTexture texture);
  bool Dissolve(TextCursor& rest);
  bool OptionalReal(TextCursor& rest, std::optional<double>& value);
  /// False: `keyword` is known, but its arguments are malformed.
  bool Statement(std::string_view keyword, TextCursor& rest);

  std::string path_;
  LineReader lines_;
  const std::function<void(std::string)>& warn_;
  std::vector<MtlMaterial> materials_;
  std::optional<MtlBlock> block_;
  bool warned_of_tr_ = false;
  CarriedFields fields_;
};

Result<std::vector<MtlMaterial>> MtlParser::Parse() {
  std::string_view line;
  while (true) {
    QUARRY_ASSIGN(const bool more, lines_.NextJoined(line));
    if (!more) break;
    Line(line);
  }
  End();
  if (const std::string left_out = fields_.Sentence(path_); !left_out.empty()) warn_(left_out);
  return std::move(materials_);
}

void MtlParser::Line(std::string_view line) {
  TextCursor rest(line);
  const std::string_view keyword = rest.Word();
  if (keyword.empty() || keyword.starts_with('#')) return;
  if (EqualsIgnoringCase(keyword, "newmtl")) return Begin(rest.Name());
  if (!block_ || Statement(keyword, rest)) return;
  warn_(lines_.FailHere(fmt::format("{} is not understood and left out", Quoted(line))).value().message);
}

void MtlParser::Begin(std::string_view name) {
  End();
  block_.emplace();
  block_->name = std::string(name);
}

void MtlParser::End() {
  if (block_) {
    if (MeansOpaque(*block_) && !std::exchange(warned_of_tr_, true))
      warn_(lines_
                .FailHere(fmt::format("the material {} has \"Tr 1\" and no \"d\"; it is taken to be opaque",
                                      Quoted(block_->name)))
                .value()
                .message);
    TakeAlphaOfColor(block_->textures);
    materials_.push_back({ToMaterial(*block_), {}});
    for (const auto& [use, texture] : block_->textures)
      materials_.back().textures.push_back(Completed(texture, *block_));
  }
  block_.reset();
}

bool MtlParser::Statement(std::string_view keyword, TextCursor& rest) {
  const auto is = [&](std::string_view name) { return EqualsIgnoringCase(keyword, name); };
  if (is("Kd")) return Color(rest, block_->kd);
  if (is("Ks")) return Color(rest, block_->ks);
  if (is("Ke")) return Color(rest, block_->ke);
  if (is("Tf")) return Color(rest, block_->tf);
  if (is("Kr")) return Color(rest, block_->kr);
  if (is("Ns")) return ParseReal(rest, block_->ns);
  if (is("Ni")) return ParseReal(rest, block_->ni);
  if (is("Pm")) return OptionalReal(rest, block_->pm);
  if (is("Pr")) return OptionalReal(rest, block_->pr);
  if (is("d")) return Dissolve(rest);
  if (is("Tr")) return OptionalReal(rest, block_->tr);
  if (is("illum")) return ParseReal(rest, block_->illum);
  if (const auto texture = MtlTextureFor(keyword)) return Texture(rest, *texture);
  fields_.Names(FieldKind::kMtlStatement, keyword);
  return true;
}

bool MtlParser::Texture(TextCursor& rest, MtlTexture texture) {
  if (!ParseMtlTexture(rest, texture)) return false;
  texture.line = lines_.line_number();
  if (!texture.left_out.empty())
    warn_(
        lines_.FailHere(fmt::format("{} of the image {} is left out", texture.left_out, Quoted(texture.file)))
            .value()
            .message);
  block_->textures.insert_or_assign(texture.binding.use, texture);
  return true;
}

bool MtlParser::Color(TextCursor& rest, std::optional<glm::dvec3>& color) {
  glm::dvec3 value;
  if (!ParseReal(rest, value.x)) return false;
  const bool grey = rest.AtEnd();
  if (grey) value.y = value.z = value.x;
  if (!grey && !(ParseReal(rest, value.y) && ParseReal(rest, value.z))) return false;
  color = value;
  return true;
}

/// "d -halo x" fades toward the silhouette; it is read as "d x".
bool MtlParser::Dissolve(TextCursor& rest) {
  TextCursor after = rest;
  if (after.Word() == "-halo") rest = after;
  return OptionalReal(rest, block_->d);
}

bool MtlParser::OptionalReal(TextCursor& rest, std::optional<double>& value) {
  double parsed;
  if (!ParseReal(rest, parsed)) return false;
  value = parsed;
  return true;
}

}  // namespace

Result<std::vector<MtlMaterial>> ReadMtl(const std::string& path,
                                         const std::function<void(std::string)>& warn) {
  QUARRY_ASSIGN(ModelReader bytes, ModelReader::Open(path));
  constexpr size_t kLook = 1024;
  bytes.Ensure(kLook);
  // A library is foreign as a model, but not here.
  const ForeignContent content = RecognizeForeign(bytes.view().substr(0, kLook), ".mtl");
  if (!content.what.empty() && content.what != kMaterialLibrary)
    return Fail(fmt::format("{}: is {}; {}", path, content.what, content.advice));
  return MtlParser(bytes, warn).Parse();
}

}  // namespace quarry
