#pragma once
// A session's log of edits and the ground that they make, as a server has them.

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/packed.h"
#include "server/edit_log/log.h"
#include "server/edit_store/store.h"

namespace ridgecast::bench {

struct EditSession {
  std::unique_ptr<edit_log::Log> log;
  edits::History history;

  static EditSession open(const std::filesystem::path& file, const std::shared_ptr<const terrain::Terrain>& terrain) {
    auto log = edit_log::Log::open(file).value();
    const edit_log::World world{std::string(terrain->name()), terrain->seed(), {}, terrain::contentHash(*terrain)};
    if (!log) log = edit_log::Log::create(file, world).value();
    auto history = edit_log::historyOf(*log, terrain, std::size_t{4} << 30).value();
    return {std::move(log), std::move(history)};
  }

  // In one transaction.
  void append(std::vector<edits::Operation> operations) {
    const std::shared_ptr<const edits::Layer> before = history.layer();
    std::vector<edit_store::Applied> edits;
    std::vector<edits::Posts> changed;
    for (edits::Operation& o : operations) {
      o = history.prepare(std::move(o)).value();
      changed.push_back(history.add(o).value());
      edits.push_back({history.last(), "", "somebody", 1'700'000'000'000'000, edits::pack(o), edits::groundOf(changed.back())});
    }
    log->append(edits, {*before, *history.layer(), changed}).value();
  }
};

}  // namespace ridgecast::bench
