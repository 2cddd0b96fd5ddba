#include "deploy/command/rays/npy.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <span>

namespace quarry {
namespace {

constexpr std::string_view kMagic("\x93NUMPY", 6);
constexpr size_t kMostHeader = 64 << 10, kHeaderBytes = 256, kReadAtOnce = 1 << 20;

/// What follows 'KEY': in a Python dictionary, without spaces before it; empty where there is no such key.
std::string_view ValueOf(std::string_view dictionary, std::string_view key) {
  for (const char quote : {'\'', '"'}) {
    const std::string quoted = quote + std::string(key) + quote;
    const size_t at = dictionary.find(quoted);
    if (at == std::string_view::npos) continue;
    std::string_view rest = dictionary.substr(at + quoted.size());
    const auto skip = [&] { rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size())); };
    skip();
    if (!rest.starts_with(':')) continue;
    rest.remove_prefix(1);
    skip();
    return rest;
  }
  return {};
}

/// The numbers of a Python tuple. Returns: false for other text.
bool ParseTuple(std::string_view text, std::vector<uint64_t>& out) {
  if (!text.starts_with('(')) return false;
  text.remove_prefix(1);
  while (true) {
    text.remove_prefix(std::min(text.find_first_not_of(" ,"), text.size()));
    if (text.starts_with(')')) return true;
    uint64_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end == text.data()) return false;
    text.remove_prefix(static_cast<size_t>(end - text.data()));
    if (text.starts_with('L')) text.remove_prefix(1);  // of Python 2
    out.push_back(number);
  }
}

}  // namespace

Result<NpyShape> ParseNpyHeader(std::string_view text) {
  NpyShape shape;
  const std::string_view type = ValueOf(text, "descr");
  if (type.size() < 5 || (type.substr(1, 3) != "<f4" && type.substr(1, 3) != "<f8") || type[0] != type[4])
    return BadUsage(
        fmt::format("its numbers are {}; give float32 or float64",
                    type.empty() ? "of no type" : std::string(type.substr(0, type.find_first_of(",}")))));
  shape.float32 = type[3] == '4';
  if (ValueOf(text, "fortran_order").starts_with("True"))
    return BadUsage("it is in Fortran's order; numpy.ascontiguousarray gives the other");
  std::vector<uint64_t> sizes;
  if (!ParseTuple(ValueOf(text, "shape"), sizes) || sizes.empty())
    return BadUsage("its header gives no shape");
  shape.columns = sizes.back();
  shape.rows = 1;
  for (size_t i = 0; i + 1 < sizes.size(); ++i)
    if (__builtin_mul_overflow(shape.rows, sizes[i], &shape.rows))
      return BadUsage("its header gives an impossible shape");
  if (shape.columns != 6 && shape.columns != 8)
    return BadUsage(fmt::format(
        "its rows have {} numbers; give 6 (origin and direction), or 8 (tnear and tfar after them)",
        shape.columns));
  if (shape.rows > (uint64_t{1} << 56)) return BadUsage("its header gives an impossible shape");
  return shape;
}

Result<NpyReader> NpyReader::Open(int fd, std::string name) {
  NpyReader reader(fd, std::move(name));
  QUARRY_TRY(reader.ReadHeader());
  return reader;
}

/// Reads until `out` is full or the file ends; the number of bytes.
Result<size_t> NpyReader::ReadSome(std::span<std::byte> out) {
  size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = ::read(fd_, out.data() + done, std::min(out.size() - done, kReadAtOnce));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Fail(fmt::format("{}: cannot read: {}", name_, ErrnoText(errno)));
    if (n == 0) break;
    done += static_cast<size_t>(n);
  }
  return done;
}

Status NpyReader::ReadHeader() {
  std::array<std::byte, 12> start{};
  const auto cut = [&](uint64_t at) {
    return BadUsage(fmt::format("{}: ends at byte {}, within its header", name_, at));
  };
  QUARRY_ASSIGN(size_t got, ReadSome(std::span(start).first(8)));
  if (got == 0) return BadUsage(fmt::format("{}: is empty; give rays as an .npy file", name_));
  if (std::memcmp(start.data(), kMagic.data(), std::min(got, kMagic.size())) != 0)
    return BadUsage(fmt::format("{}: is not an .npy file; numpy.save writes one", name_));
  if (got < 8) return cut(got);
  const auto version = static_cast<unsigned>(start[6]);
  if (version < 1 || version > 3)
    return BadUsage(fmt::format("{}: .npy version {} is unknown", name_, version));
  const size_t length_bytes = version == 1 ? 2 : 4;
  QUARRY_ASSIGN(got, ReadSome(std::span(start).subspan(8, length_bytes)));
  if (got < length_bytes) return cut(8 + got);
  size_t length = 0;
  for (size_t i = 0; i < length_bytes; ++i) length |= static_cast<size_t>(start[8 + i]) << (8 * i);
  if (length > kMostHeader)
    return BadUsage(fmt::format("{}: claims a header of {} bytes at byte 8", name_, length));
  std::string text(length, 0);
  QUARRY_ASSIGN(got, ReadSome(std::as_writable_bytes(std::span(text))));
  data_begin_ = 8 + length_bytes + length;
  if (got < length) return cut(8 + length_bytes + got);
  auto shape = ParseNpyHeader(text);
  if (!shape) return BadUsage(fmt::format("{}: {}", name_, shape.error().message));
  shape_ = *shape;
  return {};
}

Status NpyReader::Read(uint64_t rows, std::vector<double>& out) {
  buffer_.resize(rows * RowBytes());
  QUARRY_ASSIGN(const size_t got, ReadSome(buffer_));
  if (got < buffer_.size())
    return BadUsage(fmt::format("{}: ends at byte {}, within row {} of {}", name_, ByteOf(next_row_) + got,
                                next_row_ + got / RowBytes(), shape_.rows));
  next_row_ += rows;
  const size_t numbers = rows * shape_.columns, before = out.size();
  out.resize(before + numbers);
  if (shape_.float32) {
    for (size_t i = 0; i < numbers; ++i) {
      float number;
      std::memcpy(&number, buffer_.data() + i * sizeof number, sizeof number);
      out[before + i] = number;
    }
  } else if (numbers > 0) {
    std::memcpy(out.data() + before, buffer_.data(), numbers * sizeof(double));
  }
  return {};
}

Status NpyReader::CheckEnd() {
  std::array<std::byte, 1> more;
  QUARRY_ASSIGN(const size_t got, ReadSome(more));
  if (got > 0)
    return BadUsage(fmt::format("{}: goes on after its last row, at byte {}", name_, ByteOf(shape_.rows)));
  return {};
}

std::string NpyHeader(const std::string& descr, uint64_t rows) {
  std::string header(kMagic);
  header += {'\x01', '\x00', static_cast<char>((kHeaderBytes - 10) & 0xFF),
             static_cast<char>((kHeaderBytes - 10) >> 8)};
  header += fmt::format("{{'descr': {}, 'fortran_order': False, 'shape': ({},), }}", descr, rows);
  header.resize(kHeaderBytes - 1, ' ');
  return header + '\n';
}

}  // namespace quarry
