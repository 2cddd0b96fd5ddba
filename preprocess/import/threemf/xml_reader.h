#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "preprocess/import/threemf/zip_archive.h"

namespace quarry {

/// The namespaces of 3MF that are distinguished.
enum class XmlSpace : uint8_t {
  kNone,        ///< no namespace
  kCore,        ///< 3MF's own
  kMaterial,    ///< materials and properties
  kProduction,  ///< objects in several parts
  kBeamLattice,
  kSlice,
  kTriangleSets,
  kOther,
};

/// The namespace with that address, whatever its version.
XmlSpace SpaceOf(std::string_view address);

/// The attributes of an element, valid until its handler returns.
class XmlAttributes {
 public:
  explicit XmlAttributes(const char** pairs) : pairs_(pairs) {}
  /// The value of the attribute without a namespace; null: there is none.
  const char* Find(std::string_view name) const;
  /// The value of the attribute of a namespace; null: there is none.
  const char* Find(XmlSpace space, std::string_view name) const;

 private:
  const char** pairs_;
};

/// Receives a document's elements. Errors end the reading; its place in the document is added to them.
class XmlHandler {
 public:
  virtual ~XmlHandler() = default;
  virtual Status Start(XmlSpace space, std::string_view name, const XmlAttributes& attributes) = 0;
  virtual Status End(XmlSpace space, std::string_view name) = 0;
  /// Whether the last error came from elsewhere than the document, so that its place is not added.
  virtual bool failed_elsewhere() const { return false; }
  /// A prefix stands for a namespace from the next element on.
  virtual void Prefix(std::string_view /*prefix*/, std::string_view /*address*/) {}
};

/// Reads XML from a part of an archive, in pieces of 64 KiB; `on_read`, if given, gets the bytes of each. The
/// handler's errors are returned after the place: "PATH: PART, line L, column C: ...". Memory: 16 MiB at
/// most. Errors: the part is damaged, is no XML, has a document type (whose entities may grow without bound),
/// is nested deeper than 100 elements, or takes more memory.
Status ReadXml(ZipArchive& archive, uint64_t part, XmlHandler& handler,
               const std::function<void(uint64_t)>& on_read = {});

}  // namespace quarry
