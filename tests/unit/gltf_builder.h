#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

// glTF documents for tests.

namespace quarry {

using Json = nlohmann::json;

inline std::string Base64(const std::string& bytes) {
  const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t group = 0;
    for (size_t k = 0; k < 3; ++k)
      group = group << 8 | (i + k < bytes.size() ? static_cast<uint8_t>(bytes[i + k]) : 0);
    for (size_t k = 0; k < 4; ++k)
      out.push_back(i + k <= bytes.size() ? digits[group >> (18 - 6 * k) & 63] : '=');
  }
  return out;
}

/// Builds a document piece by piece: one buffer, a view for each accessor.
struct Builder {
  Json json = {{"asset", {{"version", "2.0"}}}};
  std::string buffer;
  std::vector<Json> other_buffers;  ///< after the buffer, as they stand in the document

  template <class T>
  size_t Accessor(const std::vector<T>& values, const char* type, int component_type,
                  bool normalized = false) {
    const size_t components = type == std::string("SCALAR") ? 1 : static_cast<size_t>(type[3] - '0');
    while (buffer.size() % 4 != 0) buffer.push_back('\0');
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", values.size() * sizeof(T)}});
    buffer.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    json["accessors"].push_back({{"bufferView", json["bufferViews"].size() - 1},
                                 {"componentType", component_type},
                                 {"count", values.size() / components},
                                 {"type", type}});
    if (normalized) json["accessors"].back()["normalized"] = true;
    return json["accessors"].size() - 1;
  }
  std::string Text() {
    json["buffers"] = {
        {{"byteLength", buffer.size()}, {"uri", "data:application/octet-stream;base64," + Base64(buffer)}}};
    for (const Json& other : other_buffers) json["buffers"].push_back(other);
    return json.dump();
  }
  std::string Glb() {
    json["buffers"] = {{{"byteLength", buffer.size()}}};
    for (const Json& other : other_buffers) json["buffers"].push_back(other);
    std::string text = json.dump();
    while (text.size() % 4 != 0) text.push_back(' ');
    std::string out = "glTF";
    const auto put = [&](uint32_t word) { out.append(reinterpret_cast<const char*>(&word), 4); };
    put(2);
    put(static_cast<uint32_t>(28 + text.size() + buffer.size()));
    put(static_cast<uint32_t>(text.size()));
    out += "JSON" + text;
    put(static_cast<uint32_t>(buffer.size()));
    out += std::string("BIN\0", 4) + buffer;
    return out;
  }
};

inline const std::vector<float> kSquare = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};

}  // namespace quarry
