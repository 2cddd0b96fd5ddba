#pragma once

#include <flatbuffers/flatbuffers.h>

#include <string>
#include <vector>

#include "common/base/bytes.h"

// Messages that Quarry's encoders do not make: many references to one table, by which a small message would
// unpack to a large one. Fields are numbered as in messages.fbs.

namespace quarry::test {

/// The offset of field `n` in a vtable.
inline constexpr flatbuffers::voffset_t WireField(int n) {
  return static_cast<flatbuffers::voffset_t>(4 + 2 * n);
}

/// The finished bytes of a builder.
inline Bytes TakeBytes(flatbuffers::FlatBufferBuilder& b) {
  const auto* data = reinterpret_cast<const std::byte*>(b.GetBufferPointer());
  return Bytes(data, data + b.GetSize());
}

/// A job request that refers `cameras` times to one camera, whose eye has `doubles` numbers.
inline Bytes SharedCameras(size_t cameras, size_t doubles) {
  using flatbuffers::Offset, flatbuffers::Table;
  flatbuffers::FlatBufferBuilder b;
  const auto eye = b.CreateVector(std::vector<double>(doubles, 1.0));
  const auto at = b.CreateVector(std::vector<double>{0, 0, 0});
  const auto up = b.CreateVector(std::vector<double>{0, 0, 1});
  auto start = b.StartTable();
  b.AddOffset(WireField(0), eye);
  b.AddOffset(WireField(1), at);
  b.AddOffset(WireField(2), up);
  b.AddElement<double>(WireField(3), 45, 0);
  const Offset<Table> camera(b.EndTable(start));
  const auto list = b.CreateVector(std::vector<Offset<Table>>(cameras, camera));
  const auto crop = b.CreateVector(std::vector<uint32_t>{0, 0, 0, 0});
  const auto grey = b.CreateVector(std::vector<float>{0, 0, 0});
  const auto format = b.CreateString("png");
  start = b.StartTable();
  b.AddElement<uint32_t>(WireField(0), 64, 0);
  b.AddElement<uint32_t>(WireField(1), 64, 0);
  b.AddOffset(WireField(2), crop);
  b.AddElement<uint32_t>(WireField(4), 1, 0);
  b.AddOffset(WireField(8), grey);
  b.AddOffset(WireField(9), grey);
  const Offset<Table> view(b.EndTable(start));
  start = b.StartTable();
  b.AddOffset(WireField(0), view);
  b.AddOffset(WireField(1), list);
  b.AddOffset(WireField(3), format);
  const Offset<Table> job(b.EndTable(start));
  start = b.StartTable();
  b.AddOffset(WireField(0), job);
  b.Finish(Offset<Table>(b.EndTable(start)));
  return TakeBytes(b);
}

/// A Welcome that refers `times` times to one string.
inline Bytes SharedSources(size_t times, size_t length) {
  using flatbuffers::Offset;
  flatbuffers::FlatBufferBuilder b;
  const auto text = b.CreateString(std::string(length, 'x'));
  const auto list = b.CreateVector(std::vector<Offset<flatbuffers::String>>(times, text));
  const auto id = b.CreateVector(std::vector<uint8_t>(16));
  const auto start = b.StartTable();
  b.AddOffset(WireField(0), id);
  b.AddOffset(WireField(2), list);
  b.Finish(Offset<flatbuffers::Table>(b.EndTable(start)));
  return TakeBytes(b);
}

}  // namespace quarry::test
