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

// What a store says of its textures beside their pages: sections TEXD and MTEX. Workers are not sent them.

namespace quarry {

/// One texture as the directory knows it.
struct Texture {
  std::string name;  ///< as the model calls it
  TexelLayout layout;
  std::vector<BlockEntry> pages;  ///< numbered as TextureShape does

  bool operator==(const Texture&) const = default;
};

/// A material's use of a texture.
struct MaterialTexture {
  uint32_t material = 0;
  TextureBinding binding;

  bool operator==(const MaterialTexture&) const = default;
};

/// TEXD. Appends names to `strings` and refers to them.
Bytes EncodeTextures(const std::vector<Texture>& textures, std::string& strings);
/// What of it does not depend on the compressor, for the scene id.
Bytes EncodeTextureFacts(const std::vector<Texture>& textures);
/// MTEX.
Bytes EncodeMaterialTextures(const std::vector<Material>& materials);

/// TEXD, everything checked against `begin` and `end`, the bytes of the file that pages may lie in; names are
/// taken from `strings`. Errors: a size, a kind of texels or a place that cannot be (the texture named).
Result<std::vector<Texture>> DecodeTextures(std::span<const std::byte> bytes, std::string_view strings,
                                            uint64_t begin, uint64_t end);
/// MTEX. Errors: a material, texture, use or wrap that is not there, numbers that are not finite, entries not
/// in order.
Result<std::vector<MaterialTexture>> DecodeMaterialTextures(std::span<const std::byte> bytes,
                                                            size_t materials, size_t textures);

/// One binding as MTEX has it behind the material; also kept by the preprocessor between its runs.
void PutBinding(const TextureBinding& binding, ByteWriter& out);
TextureBinding GetBinding(ByteReader& in);

/// The zero-terminated string at `offset` of `strings`, or empty.
std::string StringAt(std::string_view strings, uint32_t offset);

}  // namespace quarry
