#include "preprocess/import/threemf/xml_reader.h"

#include <expat.h>
#include <fmt/format.h>

#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <new>

namespace quarry {
namespace {

constexpr char kSeparator = '|';  // between a namespace's address and a name
constexpr size_t kMostMemory = 16 << 20;
constexpr int kMostDepth = 100;
constexpr int kXmlPieceBytes = 1 << 16;

/// Bytes that this thread's parser holds. Expat's allocator has no argument of the caller's.
thread_local size_t held_bytes = 0;

/// Memory for expat within kMostMemory. Each piece is preceded by its size.
constexpr size_t kHeader = alignof(std::max_align_t);

void* Allocate(size_t bytes) {
  if (bytes > kMostMemory - held_bytes) return nullptr;
  auto* const memory = static_cast<char*>(std::malloc(bytes + kHeader));
  if (memory == nullptr) return nullptr;
  std::memcpy(memory, &bytes, sizeof bytes);
  held_bytes += bytes;
  return memory + kHeader;
}

void Free(void* pointer) {
  if (pointer == nullptr) return;
  char* const memory = static_cast<char*>(pointer) - kHeader;
  size_t bytes;
  std::memcpy(&bytes, memory, sizeof bytes);
  held_bytes -= bytes;
  std::free(memory);
}

void* Reallocate(void* pointer, size_t bytes) {
  if (pointer == nullptr) return Allocate(bytes);
  size_t before;
  std::memcpy(&before, static_cast<char*>(pointer) - kHeader, sizeof before);
  void* const other = Allocate(bytes);
  if (other == nullptr) return nullptr;
  std::memcpy(other, pointer, before < bytes ? before : bytes);
  Free(pointer);
  return other;
}

constexpr XML_Memory_Handling_Suite kMemory{Allocate, Reallocate, Free};

struct FullName {
  XmlSpace space;
  std::string_view name;
};

FullName Split(const char* text) {
  const std::string_view whole = text;
  const size_t at = whole.rfind(kSeparator);
  if (at == whole.npos) return {XmlSpace::kNone, whole};
  return {SpaceOf(whole.substr(0, at)), whole.substr(at + 1)};
}

/// Passes a document from expat to a handler. Neither errors nor exceptions may pass through expat's C code:
/// both wait in members.
class Reading {
 public:
  Reading(ZipArchive& archive, std::string part, XmlHandler& handler)
      : archive_(archive), part_(std::move(part)), handler_(handler) {
    const char separator[] = {kSeparator, '\0'};
    parser_.reset(XML_ParserCreate_MM(nullptr, &kMemory, separator));
    if (!parser_) throw std::bad_alloc();
    XML_SetUserData(parser_.get(), this);
    XML_SetElementHandler(parser_.get(), OnStart, OnEnd);
    XML_SetStartDoctypeDeclHandler(parser_.get(), OnDoctype);
    XML_SetStartNamespaceDeclHandler(parser_.get(), OnPrefix);
  }

  Status Run(const std::function<void(uint64_t)>& on_read) {
    for (bool last = false; !last;) {
      void* const room = XML_GetBuffer(parser_.get(), kXmlPieceBytes);
      if (room == nullptr) return Wrong();
      QUARRY_ASSIGN(const size_t got, archive_.Read({static_cast<char*>(room), size_t{kXmlPieceBytes}}));
      last = got == 0;
      const XML_Status parsed = XML_ParseBuffer(parser_.get(), static_cast<int>(got), last);
      if (thrown_) std::rethrow_exception(thrown_);
      if (!status_ || parsed != XML_STATUS_OK) return Wrong();
      if (on_read) on_read(got);
    }
    return {};
  }

 private:
  struct FreeParser {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
  };

  tl::unexpected<Error> Wrong() const {
    if (!status_ && handler_.failed_elsewhere()) return tl::unexpected(status_.error());
    std::string why;
    if (!status_)
      why = status_.error().message;
    else if (const XML_Error error = XML_GetErrorCode(parser_.get()); error == XML_ERROR_NO_MEMORY)
      why =
          fmt::format("its XML needs more than {} MiB to be read, which no model's does", kMostMemory >> 20);
    else
      why = fmt::format("the XML is damaged ({})", XML_ErrorString(error));
    Error error;
    if (!status_) error = status_.error();
    error.message = fmt::format("{}: {}, line {}, column {}: {}", archive_.path(), part_,
                                XML_GetCurrentLineNumber(parser_.get()),
                                XML_GetCurrentColumnNumber(parser_.get()) + 1, why);
    return tl::unexpected(std::move(error));
  }

  template <class Call>
  void Guard(Call&& call) {
    if (!status_ || thrown_) return;
    try {
      status_ = call();
    } catch (...) {
      thrown_ = std::current_exception();
    }
    if (!status_ || thrown_) XML_StopParser(parser_.get(), XML_FALSE);
  }

  static void OnStart(void* user, const char* name, const char** attributes) {
    Reading& r = *static_cast<Reading*>(user);
    r.Guard([&]() -> Status {
      if (++r.depth_ > kMostDepth)
        return Fail(fmt::format("elements lie in each other more than {} deep", kMostDepth));
      const FullName full = Split(name);
      return r.handler_.Start(full.space, full.name, XmlAttributes(attributes));
    });
  }
  static void OnEnd(void* user, const char* name) {
    Reading& r = *static_cast<Reading*>(user);
    r.Guard([&]() -> Status {
      --r.depth_;
      const FullName full = Split(name);
      return r.handler_.End(full.space, full.name);
    });
  }
  static void OnDoctype(void* user, const char*, const char*, const char*, int) {
    static_cast<Reading*>(user)->Guard([]() -> Status {
      return Fail("has a document type (DOCTYPE), which 3MF forbids; write it without");
    });
  }
  static void OnPrefix(void* user, const char* prefix, const char* address) {
    Reading& r = *static_cast<Reading*>(user);
    r.Guard([&]() -> Status {
      r.handler_.Prefix(prefix ? prefix : "", address ? address : "");
      return {};
    });
  }

  ZipArchive& archive_;
  std::string part_;
  XmlHandler& handler_;
  std::unique_ptr<XML_ParserStruct, FreeParser> parser_;
  int depth_ = 0;
  Status status_;
  std::exception_ptr thrown_;
};

}  // namespace

XmlSpace SpaceOf(std::string_view address) {
  const auto holds = [&](std::string_view word) { return address.find(word) != address.npos; };
  if (!holds("3dmanufacturing")) return XmlSpace::kOther;
  if (holds("/core/")) return XmlSpace::kCore;
  if (holds("/material/")) return XmlSpace::kMaterial;
  if (holds("/production/")) return XmlSpace::kProduction;
  if (holds("/beamlattice/")) return XmlSpace::kBeamLattice;
  if (holds("/slice/")) return XmlSpace::kSlice;
  if (holds("/trianglesets/")) return XmlSpace::kTriangleSets;
  return XmlSpace::kOther;
}

const char* XmlAttributes::Find(std::string_view name) const {
  for (const char** pair = pairs_; pair[0] != nullptr; pair += 2)
    if (name == pair[0]) return pair[1];
  return nullptr;
}

const char* XmlAttributes::Find(XmlSpace space, std::string_view name) const {
  for (const char** pair = pairs_; pair[0] != nullptr; pair += 2)
    if (const FullName full = Split(pair[0]); full.name == name && full.space == space) return pair[1];
  return nullptr;
}

Status ReadXml(ZipArchive& archive, uint64_t part, XmlHandler& handler,
               const std::function<void(uint64_t)>& on_read) {
  QUARRY_TRY(archive.OpenPart(part));
  return Reading(archive, archive.Name(part), handler).Run(on_read);
}

}  // namespace quarry
