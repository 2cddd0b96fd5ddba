#pragma once

#include "common/scene/material.h"

namespace quarry {

/// Fills in the OpenPBR parameters of `m` (its base colour and all below) from the weights of Whitted's rays:
/// roughness is sqrt(2 / (shininess + 2)), 0 for mirrors without a highlight; metalness is the mirror's share
/// of what is sent back; what passes is transmission where it is bent or goes by Fresnel's weights, else a
/// lack of opacity. Base colour is what is sent back in all. Keeps `unlit`.
void DeriveOpenPbr(Material& m);

/// Fills in the weights of Whitted's rays from the OpenPBR parameters: of a metal the smooth part,
/// (1 - roughness)^2, is a mirror, and the rest scatters as matte paint of its colour with a highlight of the
/// same width. `bends`: what passes is bent by specular_ior; else it goes straight on, as through a pane.
/// Emission stays as it is; of an unlit material the base colour is given off instead.
void DeriveWhitted(Material& m, bool bends);

/// Whether every number of `m` lies where Material says.
bool IsSane(const Material& m);

}  // namespace quarry
