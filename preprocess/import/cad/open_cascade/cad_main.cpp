// quarry-import-cad BYTES: makes triangles of a STEP or IGES file for quarry-preprocess, which starts it and
// speaks to it through standard input and output (cad_protocol.h). May use BYTES of address space beyond the
// program's own. It is a process of its own because Open CASCADE holds models whole, may crash on damaged
// ones, and is large.

#include <fmt/format.h>

#include <Standard_Failure.hxx>
#include <Standard_OutOfMemory.hxx>
#include <cstdlib>
#include <new>
#include <string>

#include "common/base/address_space.h"
#include "common/base/descriptor.h"
#include "common/base/log.h"
#include "common/program/run_helper.h"
#include "preprocess/import/cad/open_cascade/cad_assembly.h"
#include "preprocess/import/cad/open_cascade/cad_document.h"
#include "preprocess/import/cad/open_cascade/cad_mesh.h"
#include "preprocess/import/cad/open_cascade/cad_output.h"

namespace quarry {
namespace {

constexpr uint64_t kOwnBytes = 128u << 20;  // buffers, malloc's reserve, and MemoryIsShort()'s margin

struct Request {
  CadFormat format = CadFormat::kNone;
  std::string path;
  CadDeflection deflection;
};

bool Read(Request& request) {
  std::byte header[kCadRequestBytes];
  if (!ReadAll(0, header)) return false;
  ByteReader in(header);
  request.format = static_cast<CadFormat>(in.Get<uint32_t>());
  const auto size = in.Get<uint32_t>();
  request.deflection.linear = in.Get<double>();
  request.deflection.angle = in.Get<double>();
  if (size > kMostCadText) return false;
  request.path.resize(size);
  return ReadAll(0, std::as_writable_bytes(std::span(request.path)));
}

/// Errors: an end of a sentence about the file. An empty one: memory is short.
Status Convert(const Request& request, CadOutput& out) {
  QUARRY_ASSIGN(const CadDocument document, ReadCadDocument(request.format, request.path, out));
  if (MemoryIsShort()) return Fail("");
  const CadAssembly assembly = WalkAssembly(document);
  if (assembly.instances.empty())
    return Fail(assembly.hidden > 0 ? "hides all of its shapes" : "has no shapes that Open CASCADE reads");
  if (!CadMesher(document, assembly, request.deflection, out).Run()) return Fail("");
  return {};
}

int Answer(const Request& request, CadOutput& out) {
  out.Progress(0);
  const auto end = [&](CadMessage kind, std::string_view text) {
    out.Put(kind, text);
    out.Flush();
    // Open CASCADE's own end takes seconds, and may crash.
    std::_Exit(0);
  };
  try {
    const Status status = Convert(request, out);
    if (!status)
      end(status.error().message.empty() ? CadMessage::kTooLarge : CadMessage::kRefused,
          status.error().message);
  } catch (const Standard_OutOfMemory&) {
    end(CadMessage::kTooLarge, "");
  } catch (const Standard_Failure& failure) {
    if (MemoryIsShort()) end(CadMessage::kTooLarge, "");
    end(CadMessage::kRefused, fmt::format("Open CASCADE fails on it ({})", failure.GetMessageString()));
  } catch (const std::exception&) {  // std::bad_alloc, and vectors longer than can be
    end(CadMessage::kTooLarge, "");
  }
  out.Flush();
  std::_Exit(0);
}

int Serve(uint64_t memory, int to) {
  LimitAddressSpace(kOwnBytes + memory);
  Request request;
  if (!Read(request)) return 1;
  CadOutput out(to);
  return Answer(request, out);
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) { return quarry::RunHelper<quarry::Serve>("quarry-import-cad", argc, argv); }
