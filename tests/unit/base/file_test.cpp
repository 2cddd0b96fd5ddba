#include "common/base/file.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/support/temporary_folder.h"

namespace quarry::test {

TEST_CASE("WriteFile replaces a file, and names one that cannot be written") {
  const TemporaryFolder folder;
  const std::string path = folder.file("a");
  REQUIRE(WriteFile(path, AsBytes(std::string("a long text"))));
  REQUIRE(WriteFile(path, AsBytes(std::string("short"))));
  CHECK(std::filesystem::file_size(path) == 5);
  for (const std::string& bad : {folder.file("no/such"), std::string("/dev/full")}) {
    const Status written = WriteFile(bad, AsBytes(std::string("text")));
    REQUIRE_FALSE(written.has_value());
    CHECK(written.error().message.starts_with(bad + ": cannot write: "));
  }
}

TEST_CASE("SyncFilesIn passes over folders and other names, and names a folder that cannot be read") {
  const TemporaryFolder folder;
  folder.Write("store", "x");
  folder.Write("region-0", "x");
  std::filesystem::create_directory(folder.file("store-folder"));
  std::filesystem::create_symlink("nowhere", folder.file("store-link"));
  CHECK(SyncFilesIn(folder.path()));
  CHECK(SyncFilesIn(folder.path(), "store"));
  CHECK(SyncFilesIn(folder.path(), "none"));
  const Status absent = SyncFilesIn(folder.file("no"));
  REQUIRE_FALSE(absent.has_value());
  CHECK(absent.error().message.starts_with(folder.file("no") + ": cannot be read: "));
}

}  // namespace quarry::test
