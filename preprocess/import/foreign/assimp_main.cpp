// quarry-import-assimp MODEL OUT.ply BYTES: reads a model in any format that Assimp knows and writes it as
// PLY, with NAME.materials.json beside it, for quarry-preprocess, which starts it. May use BYTES of address
// space beyond the program's own. It is a process of its own because Assimp holds models whole and may crash.

#include <assimp/DefaultIOSystem.h>
#include <assimp/config.h>
#include <assimp/material.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>
#include <strings.h>
#include <sys/stat.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <new>
#include <vector>

#include "common/base/address_space.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/math/elementary.h"
#include "common/program/run_program.h"
#include "common/scene/material_json.h"
#include "common/scene/open_pbr.h"
#include "common/voxel/parts/part_path.h"
#include "preprocess/import/foreign/collada_sets.h"
#include "preprocess/import/foreign/foreign.h"

namespace quarry {
namespace {

constexpr uint64_t kOwnBytes = 512u << 20;  // libraries, stacks, buffers

/// Opens regular files alone: a model may name a FIFO, which would block for ever.
class RegularFiles : public Assimp::DefaultIOSystem {
 public:
  Assimp::IOStream* Open(const char* path, const char* mode) override {
    struct stat info {};
    if (::stat(path, &info) != 0 || !S_ISREG(info.st_mode)) return nullptr;
    return DefaultIOSystem::Open(path, mode);
  }
};

/// A mesh with a node's transform.
struct Placed {
  const aiMesh* mesh;
  aiMatrix4x4 to_world;
  uint32_t part;
};

/// `above`: the path of the parent's part; empty for the root, which Assimp makes itself: only its meshes are
/// a part.
void Place(const aiScene& scene, const aiNode& node, const std::string& above, const aiMatrix4x4& parent,
           std::vector<Placed>& placed, std::vector<std::string>& parts) {
  const aiMatrix4x4 to_world = parent * node.mTransformation;
  std::string path = above;
  if (node.mParent != nullptr || node.mNumMeshes > 0) AppendToPath(node.mName.C_Str(), path, above.empty());
  if (node.mNumMeshes > 0) parts.emplace_back(path);
  for (unsigned i = 0; i < node.mNumMeshes; ++i)
    placed.push_back({scene.mMeshes[node.mMeshes[i]], to_world, static_cast<uint32_t>(parts.size() - 1)});
  for (unsigned i = 0; i < node.mNumChildren; ++i)
    Place(scene, *node.mChildren[i], path, to_world, placed, parts);
}

/// Whether a material's shading has a highlight. Assimp gives every material a specular colour.
bool HasHighlight(const aiMaterial& from) {
  int model = aiShadingMode_Phong;
  from.Get(AI_MATKEY_SHADING_MODEL, model);
  return model != aiShadingMode_Flat && model != aiShadingMode_Gouraud && model != aiShadingMode_Toon &&
         model != aiShadingMode_OrenNayar && model != aiShadingMode_Minnaert &&
         model != aiShadingMode_NoShading;
}

bool IsOf(const std::string& model, const char* extension) {
  return ::strcasecmp(std::filesystem::path(model).extension().c_str(), extension) == 0;
}

/// AMF states that its colours are sRGB.
bool HasSrgbColors(const std::string& model) { return IsOf(model, ".amf"); }

Material Converted(const aiMaterial& from, bool srgb) {
  Material m;
  aiString name;
  if (from.Get(AI_MATKEY_NAME, name) == aiReturn_SUCCESS) m.name = name.C_Str();
  if (m.name == AI_DEFAULT_MATERIAL_NAME) return Material{"default"};  // Assimp's own, where there is none
  const auto color = [&](const char* key, unsigned type, unsigned index, glm::vec3& to) {
    aiColor3D value;
    if (from.Get(key, type, index, value) != aiReturn_SUCCESS) return;
    to = {value.r, value.g, value.b};
    for (int a = 0; srgb && a < 3; ++a) to[a] = static_cast<float>(DecodeSrgb(to[a]));
  };
  color(AI_MATKEY_COLOR_DIFFUSE, m.diffuse);
  color(AI_MATKEY_COLOR_EMISSIVE, m.emission);
  if (HasHighlight(from)) {
    color(AI_MATKEY_COLOR_SPECULAR, m.specular);
    from.Get(AI_MATKEY_SHININESS, m.shininess);
  }
  float opacity = 1;
  if (from.Get(AI_MATKEY_OPACITY, opacity) == aiReturn_SUCCESS && opacity < 1) {
    opacity = std::max(opacity, 0.0f);
    m.diffuse *= opacity;
    m.transmittance = glm::vec3(1 - opacity);
    from.Get(AI_MATKEY_REFRACTI, m.ior);
  }
  DeriveOpenPbr(m);
  const bool metal = from.Get(AI_MATKEY_METALLIC_FACTOR, m.base_metalness) == aiReturn_SUCCESS;
  if (from.Get(AI_MATKEY_ROUGHNESS_FACTOR, m.specular_roughness) != aiReturn_SUCCESS && !metal) return m;
  color(AI_MATKEY_BASE_COLOR, m.base_color);
  m.specular_weight = 1;
  DeriveWhitted(m, false);
  return m;  // the reader of the file clamps
}

TextureWrap WrapOf(const aiMaterial& from, const char* key, aiTextureType type) {
  int mode = aiTextureMapMode_Wrap;
  from.Get(key, type, 0, mode);
  return mode == aiTextureMapMode_Mirror                                    ? TextureWrap::kMirror
         : mode == aiTextureMapMode_Clamp || mode == aiTextureMapMode_Decal ? TextureWrap::kClamp
                                                                            : TextureWrap::kRepeat;
}

/// Writes an image that lies inside of a model to PREFIX.image-HASH. Returns its path.
Result<std::string> WriteEmbedded(const aiTexture& texture, const std::string& prefix) {
  std::string bytes;
  if (texture.mHeight == 0) {
    bytes.assign(reinterpret_cast<const char*>(texture.pcData), texture.mWidth);
  } else {  // texels, as TGA of 32 bits from the upper row on, which has the same order
    const auto put = [&](unsigned value) {
      bytes.push_back(static_cast<char>(value & 255));
      bytes.push_back(static_cast<char>(value >> 8 & 255));
    };
    if (texture.mWidth > 65535 || texture.mHeight > 65535) return Fail("an image inside of it is too large");
    bytes.assign({0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    put(texture.mWidth);
    put(texture.mHeight);
    bytes.append({32, 0x28});
    bytes.append(reinterpret_cast<const char*>(texture.pcData), size_t{4} * texture.mWidth * texture.mHeight);
  }
  const std::string path =
      fmt::format("{}.image-{:016x}{}", prefix, Checksum(AsBytes(bytes)), texture.mHeight == 0 ? "" : ".tga");
  // An earlier try of the same run may have written it; it must not seem to change.
  std::error_code none;
  if (std::filesystem::file_size(path, none) == bytes.size() && !none) return path;
  QUARRY_TRY(WriteFileAtomically(path, AsBytes(bytes)));
  return path;
}

/// The textures of a material that have a use here; of several for one use the first. Their `coordinates` are
/// channels of the meshes.
Result<std::vector<MaterialLibrary::Image>> TexturesOf(const aiScene& scene, const aiMaterial& from,
                                                       const Material& material, const ColladaSets& sets,
                                                       const std::string& prefix) {
  struct Known {
    aiTextureType type;
    TextureUse use;
    glm::vec3 factor;
  };
  const Known known[] = {{aiTextureType_BASE_COLOR, TextureUse::kDiffuse, material.base_color},
                         {aiTextureType_DIFFUSE, TextureUse::kDiffuse, material.base_color},
                         {aiTextureType_SPECULAR, TextureUse::kSpecular, material.specular},
                         {aiTextureType_EMISSIVE, TextureUse::kEmission, material.emission},
                         {aiTextureType_OPACITY, TextureUse::kOpacity, glm::vec3(1)},
                         {aiTextureType_NORMALS, TextureUse::kNormal, glm::vec3(1)},
                         {aiTextureType_HEIGHT, TextureUse::kBump, glm::vec3(1)}};
  std::vector<MaterialLibrary::Image> images;
  for (const Known& k : known) {
    aiString file;
    if (from.GetTexture(k.type, 0, &file) != aiReturn_SUCCESS || file.length == 0) continue;
    if (!images.empty() && images.back().binding.use == k.use) continue;
    MaterialLibrary::Image image;
    image.file = file.C_Str();
    image.binding.use = k.use;
    // A black colour beside a texture means that the texture alone counts: formats have one or the other.
    image.binding.factor = glm::vec4(k.factor == glm::vec3(0) ? glm::vec3(1) : k.factor, 1);
    if (const aiTexture* inside = scene.GetEmbeddedTexture(file.C_Str())) {
      image.name = inside->mFilename.length > 0 ? inside->mFilename.C_Str() : file.C_Str();
      QUARRY_ASSIGN(image.file, WriteEmbedded(*inside, prefix));
    }
    int coordinates = 0;
    from.Get(AI_MATKEY_UVWSRC(k.type, 0), coordinates);
    image.coordinates =
        std::min(sets.ChannelOf(material.name, k.use, static_cast<uint32_t>(std::max(coordinates, 0))), 255u);
    image.binding.wrap_s = WrapOf(from, _AI_MATKEY_MAPPINGMODE_U_BASE, k.type);
    image.binding.wrap_t = WrapOf(from, _AI_MATKEY_MAPPINGMODE_V_BASE, k.type);
    // Assimp's v runs up.
    aiUVTransform t;
    from.Get(AI_MATKEY_UVTRANSFORM(k.type, 0), t);
    image.binding.transform = {t.mScaling.x, 0, t.mTranslation.x, 0, -t.mScaling.y, 1 - t.mTranslation.y};
    images.push_back(std::move(image));
  }
  return images;
}

/// The channel that the material's triangles carry: that of its base colour, else of its first texture.
uint32_t ChannelOf(const std::vector<MaterialLibrary::Image>& images) {
  const auto use_of = [](const MaterialLibrary::Image& image) { return image.binding.use; };
  const auto base = std::ranges::find(images, TextureUse::kDiffuse, use_of);
  if (base != images.end()) return base->coordinates;
  return images.empty() ? 0 : images.front().coordinates;
}

/// Numbers the coordinates as the PLY holds them: 0 is that channel, 1 any other.
void NumberFrom(uint32_t channel, std::vector<MaterialLibrary::Image>& images) {
  for (MaterialLibrary::Image& image : images) image.coordinates = image.coordinates == channel ? 0 : 1;
}

/// The texture coordinates of a mesh that its material uses, else the mesh's first; null: it has none.
const aiVector3D* UvsOf(const aiMesh& mesh, const std::vector<uint32_t>& channels) {
  const uint32_t channel = channels[mesh.mMaterialIndex];
  const bool has = channel < AI_MAX_NUMBER_OF_TEXTURECOORDS && mesh.HasTextureCoords(channel);
  return mesh.mTextureCoords[has ? channel : 0];
}

/// The scene's contents that the store does not carry.
std::vector<std::string> LeftOut(const aiScene& scene) {
  bool bones = false, colors = false;
  for (unsigned i = 0; i < scene.mNumMeshes; ++i) {
    bones |= scene.mMeshes[i]->HasBones();
    colors |= scene.mMeshes[i]->GetNumColorChannels() > 1;
  }
  std::vector<std::string> left_out;
  const auto note = [&](bool holds, const char* name) {
    if (holds) left_out.emplace_back(name);
  };
  note(scene.HasAnimations(), "animations");
  note(bones, "bones");
  note(scene.HasCameras(), "cameras");
  note(scene.HasLights(), "lights");
  note(colors, "second colours of vertices");
  return left_out;
}

template <class T>
void Put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

uint8_t ByteOf(float x) { return static_cast<uint8_t>(x > 0 ? std::min(x, 1.0f) * 255 + 0.5f : 0); }

/// `channels`: the texture coordinates that each material's triangles carry.
Status WritePly(const std::vector<Placed>& placed, const std::vector<uint32_t>& channels,
                const std::string& path) {
  uint64_t vertices = 0, faces = 0;
  bool normals = true, uvs = false, colors = false;
  for (const Placed& p : placed) {
    vertices += p.mesh->mNumVertices;
    for (unsigned f = 0; f < p.mesh->mNumFaces; ++f) faces += p.mesh->mFaces[f].mNumIndices == 3;
    normals &= p.mesh->HasNormals();
    uvs |= UvsOf(*p.mesh, channels) != nullptr;
    colors |= p.mesh->HasVertexColors(0);
  }
  if (faces == 0) return Fail("holds no triangles");
  if (vertices > 0xFFFFFFFFull) return Fail("has more vertices than 32 bits can count");
  QUARRY_ASSIGN(OutputFile file, OutputFile::Create(path));
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty "
      "float z\n{}{}{}"
      "element face {}\nproperty list uchar uint vertex_indices\nproperty uint material_index\nproperty uint "
      "part_index\nend_header\n",
      vertices, normals ? "property float nx\nproperty float ny\nproperty float nz\n" : "",
      uvs ? "property float u\nproperty float v\n" : "",
      colors ? "property uchar red\nproperty uchar green\nproperty uchar blue\n" : "", faces);
  for (const Placed& p : placed) {
    aiMatrix3x3 turn(p.to_world);
    turn.Inverse().Transpose();
    const aiVector3D* const own = UvsOf(*p.mesh, channels);
    for (unsigned i = 0; i < p.mesh->mNumVertices; ++i) {
      const aiVector3D v = p.to_world * p.mesh->mVertices[i];
      for (const float x : {v.x, v.y, v.z}) Put(text, x);
      if (normals) {
        const aiVector3D n = (turn * p.mesh->mNormals[i]).NormalizeSafe();
        for (const float x : {n.x, n.y, n.z}) Put(text, x);
      }
      if (uvs) {
        Put(text, own != nullptr ? own[i].x : 0.0f);
        Put(text, own != nullptr ? own[i].y : 0.0f);
      }
      if (colors) {
        const aiColor4D c = p.mesh->HasVertexColors(0) ? p.mesh->mColors[0][i] : aiColor4D(1, 1, 1, 1);
        for (const float x : {c.r, c.g, c.b}) Put(text, ByteOf(x));
      }
      if (text.size() < 1 << 16) continue;
      QUARRY_TRY(file.Write(AsBytes(text)));
      text.clear();
    }
  }
  uint32_t first = 0;
  for (const Placed& p : placed) {
    for (unsigned f = 0; f < p.mesh->mNumFaces; ++f) {
      const aiFace& face = p.mesh->mFaces[f];
      if (face.mNumIndices != 3) continue;
      Put(text, uint8_t{3});
      for (unsigned k = 0; k < 3; ++k) Put(text, first + face.mIndices[k]);
      Put(text, p.mesh->mMaterialIndex);
      Put(text, p.part);
    }
    first += p.mesh->mNumVertices;
    QUARRY_TRY(file.Write(AsBytes(text)));
    text.clear();
  }
  QUARRY_TRY(file.Write(AsBytes(text)));
  return file.Commit();
}

/// The error, with the model's name once.
Status CannotRead(const std::string& model, std::string why) {
  if (why.starts_with("No suitable reader found"))
    return Fail(
        fmt::format("{}: is in none of the formats that are read: PLY, OBJ, STL, OFF, glTF, GLB, NFF, AFF, "
                    "3MF, STEP, IGES, "
                    "and by Assimp COLLADA, AMF, FBX, 3DS, DXF, X3D and more; export it as glTF, OBJ or PLY",
                    model));
  for (size_t at; (at = why.find(model)) != why.npos;) why.replace(at, model.size(), "it");
  while (why.ends_with('.') || why.ends_with('\n')) why.pop_back();
  return Fail(fmt::format("{}: Assimp cannot read it ({}); export it as glTF, OBJ or PLY", model, why));
}

Status Run(const std::string& model, const std::string& out, uint64_t memory) {
  LimitAddressSpace(kOwnBytes + memory);
  Assimp::Importer importer;
  importer.SetIOHandler(new RegularFiles);  // the importer owns it from now on
  // Without this, Assimp makes meshes of bones that have no skin.
  importer.SetPropertyInteger(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, 1);
  const aiScene* scene = importer.ReadFile(
      model, aiProcess_Triangulate | aiProcess_SortByPType | aiProcess_JoinIdenticalVertices);
  if (!scene || !scene->mRootNode) return CannotRead(model, importer.GetErrorString());
  std::vector<Placed> placed;
  MaterialLibrary library;
  Place(*scene, *scene->mRootNode, "", aiMatrix4x4(), placed, library.parts);
  library.left_out = LeftOut(*scene);
  const bool srgb = HasSrgbColors(model);
  const std::string prefix = out.substr(0, out.size() - std::strlen(".ply"));
  const ColladaSets sets = IsOf(model, ".dae") ? ColladaSets::Read(model) : ColladaSets();
  std::vector<uint32_t> channels;
  for (unsigned i = 0; i < scene->mNumMaterials; ++i) {
    library.materials.push_back(Converted(*scene->mMaterials[i], srgb));
    QUARRY_ASSIGN(auto images,
                  TexturesOf(*scene, *scene->mMaterials[i], library.materials.back(), sets, prefix));
    channels.push_back(ChannelOf(images));
    NumberFrom(channels.back(), images);
    library.images.push_back(std::move(images));
  }
  if (const Status written = WritePly(placed, channels, out); !written)
    return Fail(fmt::format("{}: {}", model, written.error().message));
  std::ofstream json(MaterialJsonPath(out));
  WriteMaterialJson(library, json);
  if (!json.flush()) return Fail(fmt::format("{}: cannot be written", MaterialJsonPath(out)));
  return {};
}

int Main(int argc, char** argv) {
  if (argc != 4) {
    Log("quarry-import-assimp MODEL OUT.ply BYTES: started by quarry-preprocess");
    return 2;
  }
  try {
    const Status status = Run(argv[1], argv[2], std::strtoull(argv[3], nullptr, 10));
    if (status) return 0;
    Log(status.error().message);
  } catch (const std::bad_alloc&) {
    Log(fmt::format("{}: needs more than --memory: Assimp loads a model whole, in up to {} times its size",
                    argv[1], kForeignBytesPerByte));
  } catch (const std::exception& e) {
    Log(fmt::format("{}: Assimp cannot read it: {}", argv[1], e.what()));
  }
  return 1;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-import-assimp", "nothing was written"}, argc, argv, quarry::Main);
}
