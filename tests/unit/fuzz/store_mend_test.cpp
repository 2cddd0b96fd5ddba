#include "tests/fuzz/store_mend.h"

#include <catch2/catch.hpp>

#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {

TEST_CASE("A changed store with repaired checksums is read past them, to its content") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("s.quarry"), changed = folder.file("c.quarry");
  test::WriteSmallStore(path, 3);
  const std::vector<char> good = test::ReadFile(path);
  size_t past = 0;
  for (size_t at = 16; at < good.size(); at += 37) {
    std::vector<char> bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 0x11);
    test::WriteFile(changed, bad);
    CHECK_FALSE(test::FaultOf(changed).empty());
    fuzz::MendStore(std::as_writable_bytes(std::span(bad)));
    test::WriteFile(changed, bad);
    past += test::FaultOf(changed).find("checksum") == std::string::npos;
  }
  // All changes pass the checksums, except changes to the place of a section or block.
  CHECK(past > good.size() / 37 * 95 / 100);
  std::vector<char> same = good;
  fuzz::MendStore(std::as_writable_bytes(std::span(same)));
  CHECK(same == good);
}

}  // namespace quarry
