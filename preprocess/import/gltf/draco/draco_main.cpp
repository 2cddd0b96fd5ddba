// quarry-import-draco BYTES: decodes meshes for quarry-preprocess, which starts it and speaks to it through
// standard input and output (draco_protocol.h). May use BYTES of address space beyond the program's own. It
// is a process of its own because Draco holds meshes whole, and may crash on damaged ones.

#include <draco/compression/decode.h>
#include <fmt/format.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

#include "common/base/address_space.h"
#include "common/base/bytes.h"
#include "common/base/descriptor.h"
#include "common/base/log.h"
#include "common/program/processor_time.h"
#include "common/program/run_helper.h"
#include "preprocess/import/gltf/draco/draco_protocol.h"

namespace quarry {
namespace {

constexpr uint64_t kOwnBytes = 32u << 20;  // buffers, and malloc's reserve
constexpr rlim_t kMostSecondsOfMesh = 600;
constexpr size_t kPieceBytes = 1 << 20;

enum ComponentType : uint32_t { kByte = 5120, kUbyte, kShort, kUshort, kUint = 5125, kFloat };

/// glTF's number of the type in which an attribute is sent. Types that glTF does not have become floats.
ComponentType SentType(const draco::PointAttribute& attribute) {
  switch (attribute.data_type()) {
    case draco::DT_INT8:
      return kByte;
    case draco::DT_UINT8:
      return kUbyte;
    case draco::DT_INT16:
      return kShort;
    case draco::DT_UINT16:
      return kUshort;
    case draco::DT_UINT32:
      return kUint;
    default:
      return kFloat;
  }
}

void Send(int fd, std::span<const std::byte> bytes) {
  if (!WriteAll(fd, bytes)) std::_Exit(1);  // the parent is gone: nothing is left to do
}

void SendAnswer(int fd, DracoAnswer answer, std::span<const std::byte> bytes) {
  ByteWriter header;
  header.Put(static_cast<uint32_t>(answer));
  header.Put(static_cast<uint32_t>(bytes.size()));
  Send(fd, header.bytes());
  Send(fd, bytes);
}

/// Sends bytes in pieces.
class PieceWriter {
 public:
  explicit PieceWriter(int fd) : fd_(fd) { piece_.reserve(kPieceBytes + 64); }
  ~PieceWriter() { Send(fd_, piece_); }
  void Put(const void* bytes, size_t size) {
    const auto* from = static_cast<const std::byte*>(bytes);
    piece_.insert(piece_.end(), from, from + size);
    if (piece_.size() < kPieceBytes) return;
    Send(fd_, piece_);
    piece_.clear();
  }

 private:
  int fd_;
  Bytes piece_;
};

/// Whether an attribute has a value for each point; a damaged mesh may lack some.
bool HasAll(const draco::PointAttribute& attribute, uint32_t points) {
  if (!attribute.is_mapping_identity() && attribute.indices_map_size() < points) return false;
  for (uint32_t p = 0; p < points; ++p)
    if (attribute.mapped_index(draco::PointIndex(p)).value() >= attribute.size()) return false;
  return true;
}

/// Puts the value of an attribute at a point. False: it cannot be converted.
bool PutValue(const draco::PointAttribute& attribute, uint32_t point, PieceWriter& out) {
  const draco::AttributeValueIndex index = attribute.mapped_index(draco::PointIndex(point));
  const int components = attribute.num_components();
  if (SentType(attribute) == kFloat) {
    float values[4] = {};
    if (!attribute.ConvertValue<float>(index, static_cast<int8_t>(components), values)) return false;
    out.Put(values, sizeof(float) * static_cast<size_t>(components));
    return true;
  }
  const size_t size = static_cast<size_t>(draco::DataTypeLength(attribute.data_type()) * components);
  if (static_cast<size_t>(attribute.byte_stride()) < size) return false;
  out.Put(attribute.GetAddress(index), size);
  return true;
}

/// Answers by a mesh that was decoded.
void SendMesh(int out, const draco::Mesh& mesh, std::span<const uint32_t> ids) {
  std::vector<const draco::PointAttribute*> attributes;
  ByteWriter facts;
  facts.Put(uint64_t{mesh.num_points()});
  facts.Put(uint64_t{mesh.num_faces()} * 3);
  for (const uint32_t id : ids) {
    const draco::PointAttribute* attribute = mesh.GetAttributeByUniqueId(id);
    if (!attribute || attribute->num_components() < 1 || attribute->num_components() > 4)
      return SendAnswer(out, DracoAnswer::kRefused,
                        AsBytes(fmt::format("it has no attribute {} of 1 to 4 components", id)));
    if (!HasAll(*attribute, mesh.num_points()))
      return SendAnswer(out, DracoAnswer::kRefused,
                        AsBytes(fmt::format("its attribute {} lacks values", id)));
    attributes.push_back(attribute);
    facts.Put(static_cast<uint32_t>(SentType(*attribute)));
    facts.Put(uint32_t{attribute->num_components()});
    // Values that become floats are fractions by then.
    facts.Put(uint32_t{attribute->normalized() && SentType(*attribute) != kFloat});
  }
  PieceWriter pieces(out);  // nothing is allocated behind the answer
  SendAnswer(out, DracoAnswer::kMesh, facts.bytes());
  for (uint32_t f = 0; f < mesh.num_faces(); ++f)
    for (const draco::PointIndex& point : mesh.face(draco::FaceIndex(f))) {
      const uint32_t index = point.value();
      pieces.Put(&index, sizeof index);
    }
  for (const draco::PointAttribute* attribute : attributes)
    for (uint32_t p = 0; p < mesh.num_points(); ++p)
      if (!PutValue(*attribute, p, pieces)) std::abort();  // the facts are sent: only an end shows the error
}

void Answer(int out, const Bytes& compressed, std::span<const uint32_t> ids) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(compressed.data()), compressed.size());
  draco::Decoder decoder;
  const auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (decoded.ok()) return SendMesh(out, *decoded.value(), ids);
  const draco::Status& status = decoded.status();
  const bool newer =
      status.code() == draco::Status::UNKNOWN_VERSION || status.code() == draco::Status::UNSUPPORTED_VERSION;
  SendAnswer(out, newer ? DracoAnswer::kNewer : DracoAnswer::kRefused, AsBytes(status.error_msg_string()));
}

/// Reads a request and answers it. False: there is none.
bool AnswerNext(int out) {
  std::byte header[kDracoRequestBytes];
  if (!ReadAll(0, header)) return false;
  LimitProcessorTime(kMostSecondsOfMesh);
  ByteReader in(header);
  const auto size = in.Get<uint64_t>();
  const auto count = in.Get<uint32_t>();
  if (count > kMostDracoAttributes) return false;
  std::vector<uint32_t> ids(count);
  if (!ReadAll(0, std::as_writable_bytes(std::span(ids)))) return false;
  try {
    Bytes compressed(size);
    if (!ReadAll(0, compressed)) return false;
    Answer(out, compressed, ids);
    return true;
  } catch (const std::exception& e) {  // std::bad_alloc, and vectors longer than can be
    SendAnswer(out, DracoAnswer::kTooLarge, AsBytes(std::string(e.what())));
    return false;  // the request may be half read
  }
}

int Serve(uint64_t memory, int out) {
  LimitAddressSpace(kOwnBytes + memory);
  while (AnswerNext(out)) {
  }
  return 0;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunHelper<quarry::Serve>("quarry-import-draco", argc, argv);
}
