#include "preprocess/saved_tables.h"

#include "common/voxel/texture_sections.h"
#include "preprocess/import/checkpoint.h"

namespace quarry {
void PutMaterials(const std::vector<Material>& materials, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(materials.size()));
  for (const Material& m : materials) {
    PutText(m.name, out);
    for (const glm::vec3& v : {m.diffuse, m.specular, m.emission, m.reflectance, m.transmittance})
      out.PutVec3(v);
    out.Put(m.shininess);
    out.Put(m.ior);
    out.Put<uint8_t>(m.fresnel);
    out.Put(static_cast<uint32_t>(m.textures.size()));
    for (const TextureBinding& binding : m.textures) PutBinding(binding, out);
  }
}

void PutTexts(const std::vector<std::string>& texts, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(texts.size()));
  for (const std::string& text : texts) PutText(text, out);
}

std::vector<Material> GetMaterials(ByteReader& in) {
  std::vector<Material> materials;
  for (auto n = in.Get<uint32_t>(); n > 0 && in.ok(); --n) {
    Material m;
    m.name = GetText(in);
    for (glm::vec3* v : {&m.diffuse, &m.specular, &m.emission, &m.reflectance, &m.transmittance})
      *v = in.GetVec3<glm::vec3>();
    m.shininess = in.Get<float>();
    m.ior = in.Get<float>();
    m.fresnel = in.Get<uint8_t>() != 0;
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
