#include "server/edit_log/clients.h"

#include <chrono>
#include <filesystem>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "server/edit_log/database.h"

namespace ridgecast::edit_log {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kPatience{10'000};

Error unknown(const Error& e) {
  return {e.message + " It only says which client began which session's edits: remove it while no server runs, and all are counted anew."};
}

std::set<std::string, std::less<>> logsIn(const fs::path& folder) {
  std::set<std::string, std::less<>> names;
  std::error_code failed;
  for (const auto& file : fs::directory_iterator(folder, failed))
    if (file.path().extension() == ".edits") names.insert(file.path().filename().string());
  return names;
}

// How many of these the client began. The file forgets those that are gone.
Outcome<std::size_t> begunBy(std::string_view client, const std::set<std::string, std::less<>>& logs, Database& db) {
  auto select = db.prepare("SELECT log, client FROM clients");
  if (!select) return select.error();
  std::size_t count = 0;
  std::vector<std::string> gone;
  {
    Statement::Rows rows(*select);
    for (;;) {
      const auto row = rows.next();
      if (!row) return row.error();
      if (!*row) break;
      if (!logs.contains(rows.text(0)))
        gone.emplace_back(rows.text(0));
      else if (rows.text(1) == client)
        ++count;
    }
  }
  auto remove = db.prepare("DELETE FROM clients WHERE log = ?1");
  if (!remove) return remove.error();
  for (const std::string& log : gone)
    if (auto removed = remove->run(std::string_view(log)); !removed) return removed.error();
  return count;
}

}  // namespace

Outcome<std::unique_ptr<Log>> createFor(std::string_view client, std::shared_ptr<const Lock> lock, const World& world, std::size_t most) {
  expects(lock && most >= 2, "a log is begun by who holds its lock");
  const fs::path folder = lock->log().parent_path();
  const std::string name = lock->log().filename().string();
  auto db = Database::open(folder / kClientsFile, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  if (!db) return unknown(db.error());
  sqlite3_busy_timeout(db->handle(), static_cast<int>(kPatience.count()));
  Transaction transaction(*db);
  if (auto begun = transaction.begin(); !begun) return unknown(begun.error());
  if (auto made = db->run("CREATE TABLE IF NOT EXISTS clients(log TEXT PRIMARY KEY, client TEXT NOT NULL) WITHOUT ROWID"); !made)
    return unknown(made.error());
  const auto logs = logsIn(folder);
  const auto begun = begunBy(client, logs, *db);
  if (!begun) return unknown(begun.error());
  const std::string forget = "; its operator can forget some with `ridgecast-server edits forget`.";
  if (logs.size() >= most) return Error{"The server keeps the edits of at most " + std::to_string(most) + " sessions" + forget};
  if (*begun >= most / 2)
    return Error{"The server keeps the edits of at most " + std::to_string(most / 2) + " sessions that one client began" + forget};
  auto insert = db->prepare("INSERT OR REPLACE INTO clients VALUES(?1, ?2)");
  if (!insert) return unknown(insert.error());
  if (auto put = insert->run(std::string_view(name), client); !put) return unknown(put.error());
  auto log = Log::create(std::move(lock), world);
  if (log) (void)transaction.commit();  // or the client has one more
  return log;
}

}  // namespace ridgecast::edit_log
