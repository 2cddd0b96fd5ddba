#include "preprocess/spill/saved_tables.h"

#include <utility>

#include "common/voxel/catalog.h"
#include "common/voxel/texture_sections.h"
#include "common/voxel/view_sections.h"

namespace quarry {

void PutText(std::string_view text, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(text.size()));
  out.PutArray(text);
}

std::string GetText(ByteReader& in) { return std::string(AsText(in.GetSpan(in.Get<uint32_t>()))); }

void PutMaterials(const std::vector<Material>& materials, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(materials.size()));
  for (const Material& m : materials) {
    PutText(m.name, out);
    PutMaterial(m, out);
    out.Put(static_cast<uint32_t>(m.textures.size()));
    for (const TextureBinding& binding : m.textures) PutBinding(binding, out);
  }
}

void PutViews(const SceneViews& views, ByteWriter& out) {
  std::string names;
  const Bytes cameras = EncodeCameras(views.cameras, names), lights = EncodeLights(views.lights, names);
  PutText(names, out);
  for (const Bytes* bytes : {&cameras, &lights}) PutText(AsText(*bytes), out);
}

SceneViews GetViews(ByteReader& in) {
  const std::string names = GetText(in), cameras = GetText(in), lights = GetText(in);
  const auto name_at = [&](uint32_t at) -> Result<std::string> {
    return at < names.size() ? std::string(names.c_str() + at) : std::string();
  };
  return {DecodeCameras(AsBytes(cameras), name_at).value_or(std::vector<NamedCamera>()),
          DecodeLights(AsBytes(lights), name_at).value_or(std::vector<NamedLight>())};
}

void PutTexts(const std::vector<std::string>& texts, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(texts.size()));
  for (const std::string& text : texts) PutText(text, out);
}

std::vector<Material> GetMaterials(ByteReader& in) {
  std::vector<Material> materials;
  for (auto n = in.Get<uint32_t>(); n > 0 && in.ok(); --n) {
    std::string name = GetText(in);
    Material m = GetMaterial(in);
    m.name = std::move(name);
    for (auto t = in.Get<uint32_t>(); t > 0 && in.ok(); --t) m.textures.push_back(GetBinding(in));
    materials.push_back(std::move(m));
  }
  return materials;
}

std::vector<std::string> GetTexts(ByteReader& in) {
  std::vector<std::string> texts;
  for (auto n = in.Get<uint32_t>(); n > 0 && in.ok(); --n) texts.push_back(GetText(in));
  return texts;
}

}  // namespace quarry
