#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// What a signal's line says while pictures are made.
inline constexpr const char* kKeptOnSignal = "frames finished before are kept, nothing partial is left";

/// The folder of stores that were made of models: $QUARRY_CACHE_DIR, else $XDG_CACHE_HOME/quarry, else
/// ~/.cache/quarry, else one in /tmp. An empty variable is as good as none.
std::string CacheFolder();

/// The store to render: `scene` itself when it is one, else the store of that model in the cache folder. It
/// is made first unless it is there and the model, and every file that it names, has the size and time (or is
/// missing) as when it was made, by this version of the importers and the format. An unfinished one that was
/// left by a signal is gone on with. While another process makes it, this one waits.
/// Errors: no such file; what the preprocessor has refused, with its status and no sentence, since it has
/// said its own.
Result<std::string> StoreFor(const std::string& scene, bool quiet);

/// Paths of the files that a kept store is made from: the model's, and those of the files that it names.
std::vector<std::string> FilesOfKept(const std::string& store);

/// A store in the cache folder, finished or not.
struct KeptStore {
  std::string path;
  std::string model;    ///< empty: unknown
  uint64_t bytes = 0;   ///< with what lies beside it
  int64_t used_ns = 0;  ///< when it was last used, since 1970
  bool finished = true;
};

/// What is there, the least recently used first.
Result<std::vector<KeptStore>> ListKeptStores();

/// Removes stores, the least recently used first, until the cache folder holds at most `most` bytes.
/// Whoever is reading one reads on; one that is being made is left alone. Returns what is gone.
Result<std::vector<KeptStore>> ShrinkKeptStores(uint64_t most);

/// The limit on the cache folder's bytes that a person has set; 0: none. It holds after each store made.
Result<uint64_t> KeptStoresLimit();
Status SetKeptStoresLimit(uint64_t bytes);

}  // namespace quarry
