#pragma once

#include <string>

#include "common/scene/material.h"

namespace quarry::test {

/// A material with no member at its default, and no two alike.
inline Material EveryMaterial(const std::string& name) {
  Material m{name};
  m.diffuse = {0.4f, 0.5f, 0.6f};
  m.specular = {0.7f, 0.8f, 0.9f};
  m.emission = {7.5f, 1e-20f, 3e20f};
  m.reflectance = {0.1f, 0.2f, 0.3f};
  m.transmittance = {0.11f, 0.12f, 0.13f};
  m.shininess = 123.456f;
  m.ior = 1.5f;
  m.fresnel = true;
  m.unlit = true;
  m.base_color = {0.15f, 0.25f, 0.35f};
  m.base_metalness = 0.45f;
  m.specular_roughness = 0.55f;
  m.specular_weight = 0.65f;
  m.specular_color = {0.16f, 0.26f, 0.36f};
  m.specular_ior = 1.75f;
  m.transmission_weight = 0.85f;
  m.transmission_color = {0.17f, 0.27f, 0.37f};
  m.transmission_depth = 12.5f;
  m.geometry_opacity = 0.95f;
  m.is_open_pbr = false;
  return m;
}

}  // namespace quarry::test
