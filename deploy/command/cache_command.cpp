#include "deploy/command/cache_command.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "common/base/log.h"
#include "common/base/size.h"
#include "deploy/command/model_cache.h"

namespace quarry {
namespace {

Status List(bool as_json) {
  QUARRY_ASSIGN(const std::vector<KeptStore> kept, ListKeptStores());
  QUARRY_ASSIGN(const uint64_t limit, KeptStoresLimit());
  uint64_t bytes = 0;
  for (const KeptStore& store : kept) bytes += store.bytes;
  if (as_json) {
    nlohmann::ordered_json j = {{"folder", CacheFolder()}, {"bytes", bytes}, {"limit_bytes", limit}};
    j["stores"] = nlohmann::ordered_json::array();
    for (const KeptStore& s : kept)
      j["stores"].push_back({{"store", s.path},
                             {"model", s.model},
                             {"bytes", s.bytes},
                             {"used_s", static_cast<double>(s.used_ns) * 1e-9},
                             {"finished", s.finished}});
    PrintRaw(j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return {};
  }
  for (const KeptStore& s : kept)
    Print(fmt::format("{:>9}  {:%Y-%m-%d %H:%M}  {}{}\n", FormatSize(s.bytes),
                      fmt::localtime(s.used_ns / 1000000000),
                      PrintableName(s.model.empty() ? s.path : s.model), s.finished ? "" : " (unfinished)"));
  Print(fmt::format("{}: {} store{}, {}{}\n", CacheFolder(), kept.size(), kept.size() == 1 ? "" : "s",
                    FormatSize(bytes),
                    limit ? fmt::format(" of {} at most", FormatSize(limit)) : ", no limit"));
  return {};
}

Status Shrink(uint64_t most) {
  QUARRY_ASSIGN(const std::vector<KeptStore> gone, ShrinkKeptStores(most));
  uint64_t bytes = 0;
  for (const KeptStore& store : gone) bytes += store.bytes;
  Print(fmt::format("{}: removed {} store{}, {}\n", CacheFolder(), gone.size(), gone.size() == 1 ? "" : "s",
                    FormatSize(bytes)));
  return {};
}

Status Limit(const std::string& text) {
  if (text.empty()) {
    QUARRY_ASSIGN(const uint64_t limit, KeptStoresLimit());
    Print(fmt::format("{}\n", limit ? FormatSize(limit) : "no limit"));
    return {};
  }
  uint64_t bytes = 0;
  if (text != "none") {
    QUARRY_ASSIGN(bytes, ParseSize(text, "the limit"));
  }
  QUARRY_TRY(SetKeptStoresLimit(bytes));
  return bytes ? Shrink(bytes) : Status{};
}

/// Prints the path of a model's kept store, which is made if there is none.
Status Add(const std::string& model, bool quiet) {
  QUARRY_ASSIGN(const std::string store, StoreFor(model, {}, quiet));
  PrintRaw(store + "\n");
  return {};
}

}  // namespace

void AddCacheCommands(CLI::App& c, CacheArguments& a) {
  c.require_subcommand(1);
  c.footer(
      "A model that is rendered is made into a store, which is kept in $QUARRY_CACHE_DIR, else "
      "$XDG_CACHE_HOME/quarry, else ~/.cache/quarry.\n"
      "Examples:\n  quarry cache list\n  quarry cache add plant.ply\n  quarry cache limit 20G\n  quarry "
      "cache clear");
  auto* list = c.add_subcommand("list", "List the kept stores, the least recently used first");
  list->add_flag("--json", a.json, "As JSON");
  auto* add =
      c.add_subcommand("add", "Make the store of a model, or find the one that is kept, and print its path");
  add->add_option("model", a.model, "The model")->required();
  add->add_flag("--quiet", a.quiet, "No progress");
  auto* limit = c.add_subcommand(
      "limit", "Print or set the limit of bytes kept; the least recently used stores are removed first");
  limit->add_option("bytes", a.limit, "A size such as 20G, or none");
  c.add_subcommand("clear", "Remove all that is kept");
}

Status RunCacheCommand(const CLI::App& c, const CacheArguments& a) {
  if (c.got_subcommand("list")) return List(a.json);
  if (c.got_subcommand("add")) return Add(a.model, a.quiet);
  return c.got_subcommand("limit") ? Limit(a.limit) : Shrink(0);
}

}  // namespace quarry
