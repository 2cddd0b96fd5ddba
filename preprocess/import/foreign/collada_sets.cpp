#include "preprocess/import/foreign/collada_sets.h"

#include <expat.h>

#include <charconv>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace quarry {

/// The functions that expat calls while it reads the file.
class ColladaParser {
 public:
  explicit ColladaParser(ColladaSets& sets) : sets_(sets) {}

  void Read(std::istream& in) {
    const std::unique_ptr<std::remove_pointer_t<XML_Parser>, decltype(&XML_ParserFree)> parser(
        XML_ParserCreate(nullptr), XML_ParserFree);
    XML_SetUserData(parser.get(), this);
    XML_SetElementHandler(parser.get(), Begin, End);
    std::vector<char> piece(64 << 10);
    while (in) {
      in.read(piece.data(), static_cast<std::streamsize>(piece.size()));
      if (XML_Parse(parser.get(), piece.data(), static_cast<int>(in.gcount()), in.eof()) != XML_STATUS_OK)
        return;
    }
  }

 private:
  static constexpr uint64_t kMostElements = 1u << 22;  // beyond them nothing is kept

  class Attributes {
   public:
    explicit Attributes(const char** pairs) : pairs_(pairs) {}
    std::string operator[](std::string_view name) const {
      for (const char** pair = pairs_; *pair != nullptr; pair += 2)
        if (name == pair[0]) return pair[1];
      return {};
    }
    std::optional<uint32_t> Number(std::string_view name) const {
      const std::string text = (*this)[name];
      uint32_t number = 0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
      return error == std::errc() && end != text.data() ? std::optional(number) : std::nullopt;
    }

   private:
    const char** pairs_;
  };

  static void Begin(void* self, const char* name, const char** attributes) {
    static_cast<ColladaParser*>(self)->Element(name, Attributes(attributes));
  }
  static void End(void* self, const char* name) {
    ColladaParser& parser = *static_cast<ColladaParser*>(self);
    if (parser.use_ && UseOf(name) == parser.use_) parser.use_.reset();
    if (std::strcmp(name, "instance_material") == 0) parser.bound_ = nullptr;
  }

  static std::string WithoutHash(std::string url) { return url.starts_with('#') ? url.substr(1) : url; }

  static std::optional<TextureUse> UseOf(std::string_view element) {
    if (element == "diffuse") return TextureUse::kDiffuse;
    if (element == "specular") return TextureUse::kSpecular;
    if (element == "emission") return TextureUse::kEmission;
    if (element == "transparent") return TextureUse::kOpacity;
    if (element == "bump") return TextureUse::kNormal;
    return std::nullopt;
  }

  void Element(std::string_view name, const Attributes& attributes) {
    if (++elements_ > kMostElements) return;
    if (name == "effect") effect_ = attributes["id"];
    if (const auto use = UseOf(name)) use_ = use;
    if (name == "texture" && use_) sets_.effects_[effect_].emplace(*use_, attributes["texcoord"]);
    if (name == "material") {
      material_ = attributes["id"];
      sets_.ids_.emplace(attributes["name"], material_);
    }
    if (name == "instance_effect") sets_.materials_[material_].effect = WithoutHash(attributes["url"]);
    if (name == "geometry") geometry_ = attributes["id"];
    if (name == "instance_geometry") instance_ = WithoutHash(attributes["url"]);
    if (name == "instance_controller") instance_.clear();
    if (name == "instance_material") {
      bound_ = &sets_.materials_[WithoutHash(attributes["target"])];
      bound_->geometry = instance_;
    }
    if (name == "bind_vertex_input" && bound_ != nullptr && attributes["input_semantic"] == "TEXCOORD")
      bound_->sets.emplace(attributes["semantic"], attributes.Number("input_set").value_or(0));
    if (name == "input" && attributes["semantic"] == "TEXCOORD")
      for (const std::string& geometry : {geometry_, std::string()})
        sets_.channels_[geometry].emplace(attributes.Number("set").value_or(0), 0);
  }

  ColladaSets& sets_;
  uint64_t elements_ = 0;
  std::string effect_, material_, geometry_, instance_;
  std::optional<TextureUse> use_;        ///< of the element that holds the current one
  ColladaSets::Bound* bound_ = nullptr;  ///< within instance_material
};

ColladaSets ColladaSets::Read(const std::string& path) {
  ColladaSets sets;
  std::ifstream in(path, std::ios::binary);
  ColladaParser(sets).Read(in);
  for (auto& [geometry, channels] : sets.channels_) {
    uint32_t channel = 0;
    for (auto& [set, number] : channels) number = channel++;
  }
  return sets;
}

uint32_t ColladaSets::ChannelOf(const std::string& material, TextureUse use, uint32_t fallback) const {
  const auto id = ids_.find(material);
  const auto found = materials_.find(id != ids_.end() ? id->second : material);
  if (found == materials_.end()) return fallback;
  const auto effect = effects_.find(found->second.effect);
  if (effect == effects_.end()) return fallback;
  const auto name = effect->second.find(use);
  if (name == effect->second.end()) return fallback;
  const auto set = found->second.sets.find(name->second);
  if (set == found->second.sets.end()) return fallback;
  if (channels_.empty()) return fallback;
  const auto geometry = channels_.find(found->second.geometry);
  const auto& channels = geometry != channels_.end() ? geometry->second : channels_.find("")->second;
  const auto channel = channels.find(set->second);
  return channel == channels.end() ? fallback : channel->second;
}

}  // namespace quarry
