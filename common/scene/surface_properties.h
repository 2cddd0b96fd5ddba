#pragma once

#include "common/scene/material.h"

namespace quarry {

/// The numbers of a material, as they are at one point of its surface: textures replace some of them.
/// Members, units and ranges: see Material.
struct SurfaceProperties {
  glm::vec3 diffuse, specular, emission, reflectance, transmittance;
  float shininess, ior;
  bool fresnel, unlit;
  glm::vec3 base_color;
  float base_metalness, specular_roughness, specular_weight;
  glm::vec3 specular_color;
  float specular_ior, transmission_weight;
  glm::vec3 transmission_color;
  float transmission_depth, geometry_opacity;
  bool is_open_pbr;

  SurfaceProperties(const Material& m)  // NOLINT(google-explicit-constructor): a material has them everywhere
      : diffuse(m.diffuse),
        specular(m.specular),
        emission(m.emission),
        reflectance(m.reflectance),
        transmittance(m.transmittance),
        shininess(m.shininess),
        ior(m.ior),
        fresnel(m.fresnel),
        unlit(m.unlit),
        base_color(m.base_color),
        base_metalness(m.base_metalness),
        specular_roughness(m.specular_roughness),
        specular_weight(m.specular_weight),
        specular_color(m.specular_color),
        specular_ior(m.specular_ior),
        transmission_weight(m.transmission_weight),
        transmission_color(m.transmission_color),
        transmission_depth(m.transmission_depth),
        geometry_opacity(m.geometry_opacity),
        is_open_pbr(m.is_open_pbr) {}
};

}  // namespace quarry
