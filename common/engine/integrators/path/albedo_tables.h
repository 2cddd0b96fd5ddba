#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace quarry {

/// The reflected share of a smooth boundary between media, for a ray in the first medium. `cosine`: between
/// ray and normal, in [0, 1]. `ior`: of the second medium over that of the first, above 0. Source: Fresnel's
/// equations, in the form of Cook & Torrance 1982. Thread-safe.
float FresnelOf(float cosine, float ior);

/// A share of a table with `side` nodes evenly by the root of the cosine, for each of `side` roughnesses.
/// Between nodes it is bilinear. `table`: of the roughness 0 first. Thread-safe.
float ShareOfTable(const float* table, uint32_t side, float cosine, float roughness);

/// Shares of light that a rough specular layer sends back, by direction: the integrals of GGX lobes with
/// visible normals and height-correlated shadowing, which have no closed form. Made once, on first use, in
/// about 0.12 s, by arithmetic that is the same on all machines. Immutable, so thread-safe. Memory: 44 KiB.
/// Source: Turquin 2019 ("Practical multiple scattering compensation for microfacet models").
class AlbedoTables {
 public:
  static const AlbedoTables& Get();

  /// The share where all light is reflected that meets a facet; the rest left the layer between facets.
  /// `cosine`: of the direction to the normal, in [0, 1]. `roughness`: the square root of GGX's alpha, in
  /// [0, 1].
  float Reflected(float cosine, float roughness) const { return At(kFull, cosine, roughness); }
  /// The same where facets reflect as a boundary to a medium with this index, in [1, 10], does.
  float Dielectric(float cosine, float roughness, float ior) const;

 private:
  static constexpr uint32_t kSide = 32;     ///< nodes by direction and by roughness
  static constexpr uint32_t kIndices = 10;  ///< nodes by index of refraction
  static constexpr uint32_t kFull = kIndices;
  AlbedoTables();
  float At(uint32_t table, float cosine, float roughness) const {
    return ShareOfTable(&shares_[std::size_t{table} * kSide * kSide], kSide, cosine, roughness);
  }

  std::vector<float> shares_;  ///< by table, roughness and direction
};

}  // namespace quarry
