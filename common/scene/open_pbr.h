#pragma once

#include "common/scene/material.h"
#include "common/scene/surface_properties.h"

namespace quarry {

/// Derives the OpenPBR parameters of `m`, base_color and all after it, from the weights of Whitted's rays,
/// which are its form then:
/// - base_color is the sum of the scattered (divided by geometry_opacity), reflected and transmitted colours,
/// at most 1.
/// - base_metalness is the reflected share of reflected plus scattered light.
/// - specular_roughness is the fourth root of 2 / (shininess + 2); 0 for mirrors and glass without a
/// highlight.
/// - The highlight's weight, colour and index are SetHighlight()'s.
/// - Transmitted light becomes transmission where it is refracted or has Fresnel weights, else a lower
/// opacity.
/// - `unlit` is kept.
void DeriveOpenPbr(Material& m);

/// Sets weight, colour and index of the clear layer of a matt surface whose highlight has the weight
/// `specular` (Ks), as Blender reads it: at normal incidence the layer reflects 0.08 times its mean.
void SetHighlight(SurfaceProperties& m, const glm::vec3& specular);

/// Derives the weights of Whitted's rays from the OpenPBR parameters, which are a material's form then. The
/// share (1 - specular_roughness)^2 of a metal reflects as a mirror; the rest scatters as matte paint of its
/// colour, with a highlight of the same width. `bends`: transmitted rays are refracted by specular_ior;
/// otherwise they go straight on, as through a pane. An unlit material emits its base colour; the emission of
/// others is kept.
void DeriveWhitted(Material& m, bool bends);
void DeriveWhitted(SurfaceProperties& m, bool bends);
/// Whether DeriveWhitted() gives the weights that `m` has: for files that hold both forms and do not say
/// which was given.
bool AgreesWithOpenPbr(const Material& m);

/// Whether every number of `m` is in the range that Material states.
bool IsSane(const Material& m);

}  // namespace quarry
