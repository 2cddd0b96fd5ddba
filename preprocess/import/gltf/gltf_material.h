#pragma once

#include <algorithm>
#include <nlohmann/json_fwd.hpp>

#include "common/base/status.h"
#include "common/scene/material.h"
#include "preprocess/import/gltf/gltf_textures.h"

namespace quarry {

/// Member `key` of `object` if that is an object, else an empty one.
const nlohmann::json& Member(const nlohmann::json& object, const char* key);

/// Up to `count` numbers of member `key` over what `values` holds.
template <class Vector, class Json>
void ReadNumbers(const Json& object, const char* key, int count, Vector& values) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_array()) return;
  for (int i = 0; i < count && i < static_cast<int>(it->size()); ++i)
    values[i] = (*it)[static_cast<size_t>(i)].template get<typename Vector::value_type>();
}

/// A material by metal and roughness, or by specular and glossiness (KHR_materials_pbrSpecularGlossiness),
/// with what the extensions ior, specular, transmission, volume, emissive_strength and unlit say; Whitted's
/// weights follow (DeriveWhitted: what passes is bent where it has a thickness). Textures: base colour or
/// diffuse (its alpha as opacity, unless that is opaque), metal and roughness, normals, emission; each
/// binding's factor holds the glTF factors. Errors: the sink's.
Result<Material> ToMaterial(const nlohmann::json& json, size_t index, GltfTextures& textures);

}  // namespace quarry
