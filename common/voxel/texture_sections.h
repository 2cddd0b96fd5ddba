#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/material.h"
#include "common/voxel/catalog.h"
#include "common/voxel/texture_shape.h"

// The sections TEXD and MTEX: a store's textures without their pages.

namespace quarry {

/// Bytes of a texture in TEXD, its name's offset first.
inline constexpr size_t kTextureBytes = 20;

/// A material's use of a texture.
struct MaterialTexture {
  uint32_t material = 0;
  TextureBinding binding;

  bool operator==(const MaterialTexture&) const = default;
};

/// Encodes TEXD; appends the textures' names to `strings`.
Bytes EncodeTextures(const std::vector<Texture>& textures, std::string& strings);
/// The part of TEXD that does not depend on the compressor, for the scene id.
Bytes EncodeTextureFacts(const std::vector<Texture>& textures);
/// Encodes MTEX.
Bytes EncodeMaterialTextures(const std::vector<Material>& materials);

/// Decodes TEXD and checks it, without names (see StoreNames). Pages must lie in bytes [begin, end) of the
/// file.
/// Errors: an impossible size, format or position (the message names the texture).
Result<std::vector<Texture>> DecodeTextures(std::span<const std::byte> bytes, uint64_t begin, uint64_t end);
/// Decodes MTEX. Errors: an unknown material, texture, use or wrap; a number that is not finite; entries out
/// of order.
Result<std::vector<MaterialTexture>> DecodeMaterialTextures(std::span<const std::byte> bytes,
                                                            size_t materials, size_t textures);

/// Appends a binding as MTEX stores it after the material. The preprocessor also keeps bindings in this form
/// between runs.
void PutBinding(const TextureBinding& binding, ByteWriter& out);
/// The inverse of PutBinding(), unchecked.
TextureBinding GetBinding(ByteReader& in);

}  // namespace quarry
