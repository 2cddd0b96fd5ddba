#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/render_job.h"
#include "messages_generated.h"

// Reading the fields of a verified table, and packing one: for encoders and decoders of messages alone.

namespace quarry {

/// The bytes of a table.
template <class Table>
Bytes PackTable(const typename Table::NativeTableType& native) {
  flatbuffers::FlatBufferBuilder builder(256);
  builder.Finish(Table::Pack(builder, &native));
  const auto* data = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(data, data + builder.GetSize());
}

/// The verified root table, which points into `bytes`. Returns: null when not well formed.
template <class Table>
const Table* Root(std::span<const std::byte> bytes) {
  flatbuffers::Verifier verifier(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size(), 16,
                                 kMaxFrames * 2);
  if (bytes.size() < 8 || !verifier.VerifyBuffer<Table>(nullptr)) return nullptr;
  return flatbuffers::GetRoot<Table>(bytes.data());
}

inline tl::unexpected<Error> NotWellFormed() { return Fail("received a message that is not well formed"); }

template <class Vector>
size_t SizeOf(const Vector* vector) {
  return vector ? vector->size() : 0;
}

template <class T>
std::vector<T> Copy(const flatbuffers::Vector<T>* vector) {
  return vector ? std::vector<T>(vector->begin(), vector->end()) : std::vector<T>();
}

template <class V>
bool Read(const flatbuffers::Vector<typename V::value_type>* values, V& v) {
  if (SizeOf(values) != 3) return false;
  v = V(values->Get(0), values->Get(1), values->Get(2));
  return true;
}

/// Least bytes of a string in a message from Encode(), which shares none.
inline constexpr size_t kLeastStringBytes = 9;

/// Copies texts. Returns: false when their bytes exceed the message, so that texts share bytes.
inline bool Read(const flatbuffers::Vector<flatbuffers::Offset<flatbuffers::String>>* texts,
                 size_t message_bytes, std::vector<std::string>& out) {
  size_t bytes = 0;
  for (size_t i = 0; i < SizeOf(texts); ++i)
    if ((bytes += kLeastStringBytes + texts->Get(static_cast<uint32_t>(i))->size()) > message_bytes)
      return false;
  for (size_t i = 0; i < SizeOf(texts); ++i) out.push_back(texts->Get(static_cast<uint32_t>(i))->str());
  return true;
}

}  // namespace quarry
