#pragma once

#include <algorithm>
#include <nlohmann/json_fwd.hpp>

#include "common/base/status.h"
#include "common/scene/material.h"
#include "preprocess/import/gltf/gltf_textures.h"

namespace quarry {

/// Member `key` of `object` if it is an object, else an empty object.
const nlohmann::json& Member(const nlohmann::json& object, const char* key);

/// Reads up to `count` numbers of member `key` into `values`, whose other numbers stay.
template <class Vector, class Json>
void ReadNumbers(const Json& object, const char* key, int count, Vector& values) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_array()) return;
  for (int i = 0; i < count && i < static_cast<int>(it->size()); ++i)
    values[i] = (*it)[static_cast<size_t>(i)].template get<typename Vector::value_type>();
}

/// A material from metalness and roughness, or from specular and glossiness
/// (KHR_materials_pbrSpecularGlossiness), with the extensions ior, specular, transmission, volume,
/// emissive_strength and unlit. The weights of Whitted's model follow by DeriveWhitted(); light is refracted
/// where the material has a thickness.
/// Textures: base colour or diffuse (alpha as opacity, unless the material is opaque), metalness and
/// roughness, normals, emission. Each binding's factor holds the glTF factors. `uv_set` becomes the set of
/// texture coordinates that its triangles carry: that of the base colour, else of the first texture; textures
/// of other sets are left out with a warning. `alpha`: of the vertices. Errors: the sink's.
Result<Material> ToMaterial(const nlohmann::json& json, size_t index, GltfTextures& textures,
                            uint32_t& uv_set, float alpha = 1);

}  // namespace quarry
