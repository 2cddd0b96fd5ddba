#pragma once

#include <zlib.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

// 3MF archives for tests.

namespace quarry {

using ZipParts = std::vector<std::pair<std::string, std::string>>;

inline std::string LittleEndian(uint64_t value, int bytes) {
  std::string out;
  for (int i = 0; i < bytes; ++i, value >>= 8) out += static_cast<char>(value);
  return out;
}

inline std::string Deflated(const std::string& text) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, static_cast<uLong>(text.size())), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

/// A zip archive of those names and contents. `method`: 0 stored, 8 deflated, others as deflated; `flags`: 1
/// states encryption.
inline std::string Zip(const ZipParts& parts, int method = 8, int flags = 0) {
  std::string out, directory;
  for (const auto& [name, text] : parts) {
    const std::string data = method == 0 ? text : Deflated(text);
    const uint64_t crc =
        crc32(0, reinterpret_cast<const Bytef*>(text.data()), static_cast<uInt>(text.size()));
    const std::string facts = LittleEndian(20, 2) + LittleEndian(static_cast<uint64_t>(flags), 2) +
                              LittleEndian(static_cast<uint64_t>(method), 2) + LittleEndian(0, 4) +
                              LittleEndian(crc, 4) + LittleEndian(data.size(), 4) +
                              LittleEndian(text.size(), 4) + LittleEndian(name.size(), 2) +
                              LittleEndian(0, 2);
    directory +=
        "PK\1\2" + LittleEndian(20, 2) + facts + LittleEndian(0, 10) + LittleEndian(out.size(), 4) + name;
    out += "PK\3\4" + facts + name + data;
  }
  const std::string count = LittleEndian(parts.size(), 2);
  return out + directory + "PK\5\6" + LittleEndian(0, 4) + count + count + LittleEndian(directory.size(), 4) +
         LittleEndian(out.size(), 4) + LittleEndian(0, 2);
}

inline std::string Relationship(const std::string& target, const std::string& type) {
  return "<Relationship Target=\"" + target + "\" Id=\"r" + target + "\" Type=\"" + type + "\"/>";
}

inline const char* const kModelType = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel";

inline std::string Relationships(const std::string& list) {
  return "<?xml version=\"1.0\"?><Relationships "
         "xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">" +
         list + "</Relationships>";
}

/// The parts of a 3MF with that model.
inline ZipParts ThreeMfParts(const std::string& model) {
  return {{"[Content_Types].xml", "<Types/>"},
          {"_rels/.rels", Relationships(Relationship("/3D/3dmodel.model", kModelType))},
          {"3D/3dmodel.model", model}};
}

/// A model part. `attributes`: of its root.
inline std::string ThreeMfModel(const std::string& resources, const std::string& build,
                                const std::string& attributes = "unit=\"millimeter\"") {
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model " + attributes +
         " xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" "
         "xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" "
         "xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\" "
         "xmlns:b=\"http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02\">\n<resources>" +
         resources + "</resources>\n<build>" + build + "</build></model>";
}

/// A mesh of the square from (0, 0) to (1, 1): two triangles, with those attributes.
inline std::string SquareMesh(const std::string& first = "", const std::string& second = "") {
  return "<mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>"
         "<vertex x=\"1\" y=\"1\" z=\"0\"/><vertex x=\"0\" y=\"1\" z=\"0\"/></vertices>\n<triangles>"
         "<triangle v1=\"0\" v2=\"1\" v3=\"2\" " +
         first + "/><triangle v1=\"0\" v2=\"2\" v3=\"3\" " + second + "/></triangles></mesh>";
}

inline std::string ThreeMfObject(int id, const std::string& content, const std::string& attributes = "") {
  return "<object id=\"" + std::to_string(id) + "\" type=\"model\" " + attributes + ">" + content +
         "</object>\n";
}

inline std::string Components(const std::string& list) { return "<components>" + list + "</components>"; }

inline std::string Component(int id, const std::string& attributes = "") {
  return "<component objectid=\"" + std::to_string(id) + "\" " + attributes + "/>";
}

inline std::string Item(int id, const std::string& attributes = "") {
  return "<item objectid=\"" + std::to_string(id) + "\" " + attributes + "/>";
}

/// "transform" of a move.
inline std::string Moved(const std::string& place) { return "transform=\"1 0 0 0 1 0 0 0 1 " + place + "\""; }

}  // namespace quarry
