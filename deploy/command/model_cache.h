#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "deploy/command/import_options.h"

namespace quarry {

/// The text of PrintOnSignal() while pictures are rendered.
inline constexpr const char* kKeptOnSignal = "frames finished before are kept, nothing partial is left";

/// The folder of stores made from models: $QUARRY_CACHE_DIR, else $XDG_CACHE_HOME/quarry, else
/// ~/.cache/quarry, else /tmp/quarry-cache-UID. An empty variable counts as unset.
std::string CacheFolder();

/// The store to render: `scene` itself if it is a store, else the store of that model in the cache folder. A
/// store is reused while the model, and every file that the model names, has the recorded size and times (or
/// is still missing), importer and format have the same version, and its catalog is sound; every byte of it
/// where it was written to since its last use. Otherwise it is made; an unfinished store is resumed. Blocks
/// while another process makes the store. The store has the model's permissions, its folder is the user's
/// alone.
/// Errors: no such file; a folder that others may write to; failure of the preprocessor, with its exit status
/// and no message, because it has printed its own; (usage) import options beside a store.
Result<std::string> StoreFor(const std::string& scene, const ImportArguments& import, bool quiet);

/// The store of an environment in the same way: of an image, or `place` itself. Errors: as StoreFor();
/// (usage) it is neither an image of radiance nor a store of one.
Result<std::string> EnvironmentStoreFor(const std::string& place, bool quiet);

/// Removes a kept store that has damaged bytes, after a failure that they may explain, so that StoreFor()
/// makes it anew. Returns: whether there was damage; false where no store is kept of `model`.
Result<bool> DiscardDamaged(const std::string& model, const ImportArguments& import);

/// The files that a kept store is made from: the model and the files that it names. Empty when unknown.
std::vector<std::string> FilesOfKept(const std::string& store);

/// A store in the cache folder, finished or not.
struct KeptStore {
  std::string path;
  std::string model;    ///< empty when unknown
  uint64_t bytes = 0;   ///< bytes of the store and the files beside it
  int64_t used_ns = 0;  ///< time of the last use, in ns since 1970
  bool finished = true;
};

/// The kept stores, least recently used first: the stores with a record of ours beside them. Errors: the
/// folder cannot be listed.
Result<std::vector<KeptStore>> ListKeptStores();

/// Removes stores, least recently used first, until the cache folder holds at most `most` bytes. A process
/// that reads a removed store can continue; a store that is being made is kept. Returns: the removed stores.
Result<std::vector<KeptStore>> ShrinkKeptStores(uint64_t most);

/// The user's limit of bytes in the cache folder; 0 for none. Applied after each store is made. Errors: the
/// file with the limit is not readable.
Result<uint64_t> KeptStoresLimit();
/// Sets the limit; 0 for none. Does not remove stores. Errors: write errors.
Status SetKeptStoresLimit(uint64_t bytes);

}  // namespace quarry
